# %% [markdown]
# # 9 Clear of obstacles
#
# With the hand fixed, the elbow can still turn about the line from shoulder to wrist. If the arm is covered by spheres and
# its surroundings are spheres and half-spaces, the swivels at which nothing meets are known in closed form. Plans, control
# loops and batches use them.

# %%
import matplotlib.pyplot as plt
import numpy as np

import jaxik
from jaxik.view import draw_arm, draw_energy_map

plt.rcParams["figure.dpi"] = 70
model = jaxik.with_body(jaxik.presets.iiwa14(), jaxik.Body.preset("iiwa14"))
path = jaxik.fit_path(model, jaxik.example_path("wave"))[::10]
print(f"{len(path)} waypoints in {path.time[-1] - path.time[0]:.1f} s; {model.notes[-1]}")

# %% [markdown]
# ## Reaching round a post
#
# First a plan in an empty room. Then a post is put where its elbow passes.

# %%
free = jaxik.plan(model, path, gap=None)
points = np.asarray(jaxik.joint_positions(model, free.trajectory.q))
elbow, line = points[:, 1].mean(axis=0), points[:, 2].mean(axis=0) - points[:, 0].mean(axis=0)
foot = elbow * [1, 1, 0] + 0.05 * np.cross(line, [0, 0, 1]) / np.linalg.norm(np.cross(line, [0, 0, 1]))
heights = np.arange(0.0, elbow[2] + 0.1, 0.04)
post = jaxik.World(foot + heights[:, None] * [0, 0, 1], 0.05, normals=[[0, 0, -1.0]], offsets=[0.0])
found = jaxik.clearance(model, free.trajectory.q, post)
print(
    f"the motion in an empty room would overlap by {-1e3 * float(found.distance.min()):.0f} mm: "
    f"{found.describe(int(found.distance.argmin()))}"
)

# %%
plan = jaxik.plan(model, path, world=post, clearance=0.03, gap=None)
along = plan.clearance()
print(f"{plan.status.name}; energy {plan.energy / free.energy:.2f} times that in an empty room")
print(
    f"{1e3 * along.at_waypoints.min():.1f} mm at the waypoints, at least {1e3 * along.between.min():.1f} mm between them"
)
figure = draw_arm(model, plan.trajectory, path, world=post)
figure.set_dpi(75)
figure

# %% [markdown]
# The energy map shows what the post takes: gray swivels are beyond limits or in collision. White is the plan, dashed the one
# of the empty room.

# %%
costs = jaxik.energy_map(model, path, plan.branch, world=post)
figure = draw_energy_map(costs, plan, {"empty room": free.trajectory})
figure.set_dpi(75)
figure

# %% [markdown]
# ## Two arms side by side
#
# The other arm is a world too: its spheres at its postures, one world per waypoint. Here it waves beside the first one with
# its elbow turned toward it.

# %%
toward = jaxik.swivel_toward(model, path.target, direction=np.array([0.0, -1.0, 0.0]))
other = jaxik.solve_ik(model, path.target, toward).best(q_now=free.trajectory.q).q
for gap in (0.5, 0.4):
    beside = jaxik.as_obstacles(model, other, base=jaxik.Pose(np.array([0.0, gap, 0.0]), np.eye(3)))
    alone = jaxik.clearance(model, free.trajectory.q, beside)
    closest = int(alone.distance.argmin())
    print(f"{gap} m apart, without regard: {1e3 * float(alone.distance[closest]):.0f} mm, {alone.describe(closest)}")
    both = jaxik.plan(model, path, world=beside, clearance=0.005, gap=None)
    print(
        f"  planned: {both.status.name}",
        f"with energy {both.energy / free.energy:.2f}" if both.ok else both.problems[0],
    )

# %% [markdown]
# ## A moving ball
#
# A ball flies along the upper arm. One world per waypoint, and the plan makes way before it comes.

# %%
share = np.linspace(-1.0, 1.0, len(path))[:, None]
ball = elbow + [0.0, 0.0, 0.08] + share * np.array([0.3, 0.5, 0.0])
moving = jaxik.World(ball[:, None], np.full((len(path), 1), 0.07))
evading = jaxik.plan(model, path, world=moving, gap=None)
plt.figure(figsize=(6, 2.8))
for name, motion in (("empty room", free), ("ball", evading)):
    distance = jaxik.clearance(model, motion.trajectory.q, moving).distance
    plt.plot(path.time, 1e3 * np.asarray(distance), label=name)
plt.axhline(0.0, color="gray", linewidth=0.8)
plt.xlabel("time [s]")
plt.ylabel("distance [mm]")
plt.legend(frameon=False)
plt.tight_layout()
plt.show()

# %% [markdown]
# A control loop does not know where the ball will be: `jaxik.follow(model, target, q, dt, world=world)` takes the world of
# the moment, gives way, and says `BLOCKED` where it cannot go on. `jaxik view --arm iiwa14 --world FILE.json` shows the arm
# among obstacles to drag.
