# %% [markdown]
# # 2 Batched inverse kinematics and gradients
#
# A thousand targets are one call, and every argument of that call can be differentiated: target, swivel, even the arm.

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
# Random postures within the limits give targets that can be reached. `swivel_of` says which swivel and branch each one
# was; `solve_ik` at that swivel has to give it back in that branch.

# %%
q = jax.random.uniform(jax.random.key(0), (1000, 7), minval=0.9 * arm.lower, maxval=0.9 * arm.upper)
target = jaxik.forward_kinematics(arm, q)
swivel, branch = jaxik.swivel_of(arm, q)
solution = jaxik.solve_ik(arm, target, swivel)
back = jnp.take_along_axis(solution.q, branch[:, None, None], axis=1)[:, 0]
print("shapes:", solution.q.shape, solution.status.shape)
off = jnp.abs(back - q).max(axis=1)
print(f"difference to where we came from, float32: median {jnp.median(off):.1e}, worst {off.max():.1e} rad")

# %% [markdown]
# (The worst row lies next to a singular posture, where little of the tool is much of a joint; float64 has nine digits more.)
#
# All eight branches of every row reach the target; limits decide how many a robot can take:

# %%
counts = np.bincount(np.asarray(solution.ok.sum(axis=1)), minlength=9)
plt.figure(figsize=(5, 2.4))
plt.bar(range(9), counts, color="#2a6f97")
plt.xlabel("usable branches")
plt.ylabel("targets of 1000")
plt.tight_layout()
plt.show()

# %% [markdown]
# ## A gradient in the swivel
#
# How high is the elbow, and how does turning it change that? One reverse pass gives all thousand slopes.


# %%
def height(swivel):
    """Of all elbows together [m]."""
    return jaxik.joint_positions(arm, jaxik.solve_ik(arm, target, swivel).q[:, 0])[:, 1, 2].sum()


slope = jax.grad(height)(swivel)
step = 1e-2
rise = (height(swivel.at[0].add(step)) - height(swivel.at[0].add(-step))) / (2 * step)
print(f"slope of row 0: {slope[0]:.4f} m/rad, by differences {rise:.4f}")

# %% [markdown]
# ## A gradient in the target
#
# The Jacobian of the inverse: how joints follow the tool, at a fixed swivel. For seven joints it is the inverse of the usual
# Jacobian extended by the swivel. We look at a row whose elbow is well bent.


# %%
row = int(jnp.argmin(jnp.abs(q[:, 3] - 1.4)))


def joints(shift, turn):
    """Joint angles of that row in its own branch, for a tool moved and an elbow turned a little."""
    moved = jaxik.Pose(target.position[row] + shift, target.rotation[row])
    return jaxik.solve_ik(arm, moved, swivel[row] + turn).q[branch[row]]


by_position, by_swivel = jax.jacfwd(joints, argnums=(0, 1))(jnp.zeros(3), 0.0)
np.set_printoptions(precision=3, suppress=True)
print("dq/dp [rad/m]:\n", np.asarray(by_position))
print("dq/dswivel [rad/rad]:", np.asarray(by_swivel))

# %% [markdown]
# Moving only the elbow must not move the tool:

# %%
tool = lambda q: jaxik.forward_kinematics(arm, q).position  # noqa: E731
_, speed = jax.jvp(tool, (q[row],), (by_swivel,))
print(f"tool speed while the elbow turns: {float(jnp.linalg.norm(speed)):.1e} m/rad")

# %% [markdown]
# ## A gradient in the arm
#
# An arm is a pytree of arrays, so its dimensions are as good an argument as any. How would the elbow joint change with a
# longer forearm?

# %%
by_arm = jax.grad(lambda a: jaxik.solve_ik(a, target, swivel).q[row, branch[row], 3])(arm)
print("d(q4)/d(wrist) [rad/m]:", np.asarray(by_arm.wrist), " d(q4)/d(elbow):", np.asarray(by_arm.elbow))

# %% [markdown]
# ## Following a gradient
#
# Ten elbows are raised as high as they go, each while its hand stays where it is: gradient ascent on the swivel alone.

# %%
few = jax.tree.map(lambda x: x[:10], target)
pick = branch[:10]


@jax.jit
def climb(swivel):
    """One step up, and how high the elbows are."""

    def heights(swivel):
        q = jax.vmap(lambda rows, b: rows[b])(jaxik.solve_ik(arm, few, swivel).q, pick)
        return jaxik.joint_positions(arm, q)[:, 1, 2]

    up = jax.grad(lambda s: heights(s).sum())(swivel)
    return swivel + 2.0 * up, heights(swivel)


angle, seen = swivel[:10], []
for _ in range(60):
    angle, now = climb(angle)
    seen.append(np.asarray(now))
plt.figure(figsize=(5.5, 2.8))
plt.plot(np.array(seen), color="#2a6f97", linewidth=1.2)
plt.xlabel("step")
plt.ylabel("height of the elbow [m]")
plt.tight_layout()
plt.show()
