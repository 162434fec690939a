# %% [markdown]
# # 2 Batched inverse kinematics and gradients
#
# A thousand targets take one call, which is differentiable in every argument: the target, the swivel and the arm.

# %%
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import jaxik

plt.rcParams["figure.dpi"] = 80
model = jaxik.presets.iiwa14()
arm = model.arm

# %% [markdown]
# ## A thousand targets at once
#
# Random postures within the limits give reachable targets. `swivel_of` returns the swivel and the branch of each posture,
# and `solve_ik` at this swivel returns the posture in this branch.

# %%
q = jax.random.uniform(jax.random.key(0), (1000, 7), minval=0.9 * arm.lower, maxval=0.9 * arm.upper)
target = jaxik.forward_kinematics(arm, q)
swivel, branch = jaxik.swivel_of(arm, q)
solution = jaxik.solve_ik(arm, target, swivel)
back = jnp.take_along_axis(solution.q, branch[:, None, None], axis=1)[:, 0]
print("shapes:", solution.q.shape, solution.status.shape)
off = jnp.abs(back - q).max(axis=1)
print(f"difference from the original postures, float32: median {jnp.median(off):.1e}, max {off.max():.1e} rad")

# %% [markdown]
# The largest difference is next to a singular posture, where small motions of the tool are large motions of a joint;
# float64 has nine more digits.
#
# All eight branches of every row reach the target. The joint limits determine how many are feasible:

# %%
counts = np.bincount(np.asarray(solution.ok.sum(axis=1)), minlength=9)
plt.figure(figsize=(5, 2.4))
plt.bar(range(9), counts, color="#2a6f97")
plt.xlabel("feasible branches")
plt.ylabel("targets of 1000")
plt.tight_layout()
plt.show()

# %% [markdown]
# ## Gradient in the swivel
#
# One reverse pass gives the derivatives of all thousand elbow heights in their swivels.


# %%
def height(swivel):
    """Return the sum of the heights of all elbows [m]."""
    return jaxik.joint_positions(arm, jaxik.solve_ik(arm, target, swivel).q[:, 0])[:, 1, 2].sum()


slope = jax.grad(height)(swivel)
step = 1e-2
rise = (height(swivel.at[0].add(step)) - height(swivel.at[0].add(-step))) / (2 * step)
print(f"row 0: derivative {slope[0]:.4f} m/rad, finite difference {rise:.4f}")

# %% [markdown]
# ## Gradient in the target
#
# The Jacobian of the inverse kinematics maps tool velocities to joint velocities at a constant swivel. For seven joints it
# is the inverse of the usual Jacobian extended by the swivel. This row has a bent elbow:


# %%
row = int(jnp.argmin(jnp.abs(q[:, 3] - 1.4)))


def joints(shift, turn):
    """Return the joint angles of the row in its branch, for a displaced tool and swivel."""
    moved = jaxik.Pose(target.position[row] + shift, target.rotation[row])
    return jaxik.solve_ik(arm, moved, swivel[row] + turn).q[branch[row]]


by_position, by_swivel = jax.jacfwd(joints, argnums=(0, 1))(jnp.zeros(3), 0.0)
np.set_printoptions(precision=3, suppress=True)
print("dq/dp [rad/m]:\n", np.asarray(by_position))
print("dq/dswivel [rad/rad]:", np.asarray(by_swivel))

# %% [markdown]
# A change of the swivel must not move the tool:

# %%
tool = lambda q: jaxik.forward_kinematics(arm, q).position  # noqa: E731
_, speed = jax.jvp(tool, (q[row],), (by_swivel,))
print(f"motion of the tool per swivel: {float(jnp.linalg.norm(speed)):.1e} m/rad")

# %% [markdown]
# ## Gradient in the arm
#
# An arm is a pytree of arrays, so its dimensions are arguments like any other. This is the derivative of the elbow joint's
# angle in the positions of wrist and elbow:

# %%
by_arm = jax.grad(lambda a: jaxik.solve_ik(a, target, swivel).q[row, branch[row], 3])(arm)
print("d(q4)/d(wrist) [rad/m]:", np.asarray(by_arm.wrist), " d(q4)/d(elbow):", np.asarray(by_arm.elbow))

# %% [markdown]
# ## Gradient ascent
#
# Ten elbows are raised as high as possible with fixed hands, by gradient ascent on the swivel.

# %%
few = jax.tree.map(lambda x: x[:10], target)
pick = branch[:10]


@jax.jit
def climb(swivel):
    """Return the swivels after one step, and the heights of the elbows before it."""

    def heights(swivel):
        q = jax.vmap(lambda rows, b: rows[b])(jaxik.solve_ik(arm, few, swivel).q, pick)
        return jaxik.joint_positions(arm, q)[:, 1, 2]

    up = jax.grad(lambda s: heights(s).sum())(swivel)
    return swivel + 2.0 * up, heights(swivel)


angle, history = swivel[:10], []
for _ in range(60):
    angle, now = climb(angle)
    history.append(np.asarray(now))
plt.figure(figsize=(5.5, 2.8))
plt.plot(np.array(history), color="#2a6f97", linewidth=1.2)
plt.xlabel("step")
plt.ylabel("height of the elbow [m]")
plt.tight_layout()
plt.show()
