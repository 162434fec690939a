# %% [markdown]
# # 3 Feasible arcs and singular postures
#
# With a fixed hand, the elbow moves on a circle. The feasible part of this circle is known in closed form: a few arcs per
# branch. At singular postures, values and derivatives are finite.

# %%
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import jaxik
from jaxik.view import draw_arcs

plt.rcParams["figure.dpi"] = 80
model = jaxik.presets.iiwa14()
arm = model.arm
q = jnp.radians(jnp.array([30.0, 60.0, 20.0, -90.0, 40.0, 70.0, 0.0]))
target = jaxik.forward_kinematics(arm, q)
swivel, branch = jaxik.swivel_of(arm, q)

# %% [markdown]
# ## The arcs of one target

# %%
arcs = jaxik.swivel_arcs(arm, target)
for b in range(8):
    intervals = [
        f"{np.degrees(a):.1f}° to {np.degrees(e):.1f}°"
        for a, e, v in zip(arcs.start[b], arcs.end[b], arcs.valid[b], strict=True)
        if v
    ]
    print(f"branch {b}: {', '.join(intervals) or 'none'}")
draw_arcs(arcs, swivel=float(swivel), branch=int(branch))

# %% [markdown]
# ## Exact, not sampled
#
# Many solvers sample the swivel, here at 36 values. A tight limit on one joint leaves arcs narrower than the sampling
# interval, which the samples miss.

# %%
import dataclasses

grid = jnp.linspace(-jnp.pi, jnp.pi, 36, endpoint=False)
widths, found = np.array([40.0, 10.0, 4.0, 2.0, 1.0, 0.5]), []
for width in widths:
    # Limit joint 1 to a window of this width around its angle at a feasible swivel.
    middle = jaxik.solve_ik(arm, target, swivel + 0.03).q[branch, 0]
    half = jnp.radians(width / 2)
    tight = dataclasses.replace(arm, lower=arm.lower.at[0].set(middle - half), upper=arm.upper.at[0].set(middle + half))
    exact = jaxik.swivel_arcs(tight, target)
    sampled = jaxik.solve_ik(tight, jax.tree.map(lambda x: jnp.broadcast_to(x, (36, *x.shape)), target), grid).ok
    found.append((float(jnp.degrees(exact.width[branch])), int(sampled[:, branch].sum())))
for width, (size, hits) in zip(widths, found, strict=True):
    print(f"window of {width:4.1f}°: arcs of {size:6.2f}° in branch {int(branch)}, samples inside: {hits}")

# %% [markdown]
# ## Along a line
#
# The arcs of 200 targets on a line take one call. Feasible swivels of the original branch are green.

# %%
shift = jnp.linspace(-0.45, 0.45, 200)
line = jaxik.Pose(
    target.position + shift[:, None] * jnp.array([0.0, 1.0, 0.0]), jnp.broadcast_to(target.rotation, (200, 3, 3))
)
along = jaxik.swivel_arcs(arm, line)
grid = jnp.linspace(-jnp.pi, jnp.pi, 361)
inside = jax.vmap(lambda s: along.contains(jnp.full(200, s))[:, branch])(grid)
plt.figure(figsize=(6, 3))
plt.pcolormesh(shift, np.degrees(grid), inside, cmap="Greens", vmin=0, vmax=1.4)
plt.xlabel("target moved along y [m]")
plt.ylabel("swivel [°]")
plt.title(f"feasible swivels of branch {int(branch)}", fontsize=10)
plt.tight_layout()
plt.show()

# %% [markdown]
# ## At a singular posture
#
# If the hand is aligned with the forearm (joint 6 at zero), only the sum of joints 5 and 7 is determined. Many solvers
# return NaN there, or a NaN gradient. Here, the status reports it, and derivatives are those of motions that the arm can
# follow.

# %%
singular = q.at[5].set(0.0)
there = jaxik.forward_kinematics(arm, singular)
swivel_there, branch_there = jaxik.swivel_of(arm, singular)
solution = jaxik.solve_ik(arm, there, swivel_there)
print("status of its branch:", jaxik.Status(int(solution.status[branch_there])).name)
print(f"residual: {float(solution.residual.position[branch_there]):.1e} m")
slope = jax.jacrev(lambda s: jaxik.solve_ik(arm, there, s).q[branch_there])(swivel_there)
print("dq/dswivel, finite:", bool(jnp.isfinite(slope).all()), np.asarray(slope).round(3))

# %% [markdown]
# ## Out of reach
#
# Targets out of reach have a status, too. The wrist is then placed at the nearest reachable point on its ray.

# %%
scale = jnp.linspace(0.8, 2.0, 60)
away = jaxik.Pose(scale[:, None] * target.position, jnp.broadcast_to(target.rotation, (60, 3, 3)))
reaching = jaxik.solve_ik(arm, away, jnp.zeros(60))
plt.figure(figsize=(6, 2.4))
plt.plot(scale, reaching.residual.position[:, 0], color="#2a6f97")
plt.xlabel("distance of the target, relative to the first")
plt.ylabel("residual [m]")
plt.tight_layout()
plt.show()
print(
    {jaxik.Status(int(s)).name for s in np.unique(reaching.status[:, 0])},
    "finite:",
    bool(jnp.isfinite(reaching.q).all()),
)
