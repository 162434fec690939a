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

# %% [markdown]
# ## Following a moving hand
#
# A hand that turns once in place, as a joystick may ask for, runs into the end of a wrist's range: the nearest posture on
# target jumps to another branch. `follow` never moves a joint faster than it may: it changes the branch at full speed, says
# how far the tool is off meanwhile, and catches up.

# %%
dt, frames = 0.02, 300
angle = 2 * jnp.pi * jnp.clip(jnp.arange(frames) / 200, 0, 1)
zero, one = jnp.zeros(frames), jnp.ones(frames)
about_z = jnp.array(
    [[jnp.cos(angle), -jnp.sin(angle), zero], [jnp.sin(angle), jnp.cos(angle), zero], [zero, zero, one]]
)
stream = jaxik.Pose(jnp.broadcast_to(target.position, (frames, 3)), target.rotation @ jnp.moveaxis(about_z, -1, 0))


@jax.jit
def nearest_each(stream):
    """Return the nearest postures of the frames, each from the one before."""

    def step(q_now, hand):
        q_next = jaxik.solve_nearest(arm, hand, q_now).q
        return q_next, q_next

    return jax.lax.scan(step, q, stream)[1]


@jax.jit
def follow_each(stream):
    """Return the steps of an arm that follows the frames."""

    def step(q_now, hand):
        move = jaxik.follow(arm, hand, q_now, dt)
        return move.q, move

    return jax.lax.scan(step, q, stream)[1]


followed = follow_each(stream)
share = {
    name: np.abs(np.diff(np.asarray(postures), axis=0)).max(axis=1) / dt
    for name, postures in (("solve_nearest", nearest_each(stream)), ("follow", followed.q))
}
figure, (top, bottom) = plt.subplots(2, 1, figsize=(6, 4), sharex=True)
for (name, speed), color in zip(share.items(), ("#bc4b51", "#2a6f97"), strict=True):
    top.semilogy(dt * np.arange(1, frames), np.maximum(speed, 1e-3), color=color, label=name)
top.set_ylabel("fastest joint [rad/s]")
top.legend()
bottom.plot(dt * np.arange(frames), np.degrees(followed.lag.rotation), color="#2a6f97")
bottom.set_xlabel("time [s]")
bottom.set_ylabel("lag [°]")
plt.tight_layout()
plt.show()
states = [jaxik.FollowStatus(int(s)).name for s in followed.status]
print({name: states.count(name) for name in sorted(set(states))}, "last:", states[-1])
