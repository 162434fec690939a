# %% [markdown]
# # 5 Learning the elbow
#
# Two networks that predict the elbow. A policy is trained *through* the closed form: its loss is the energy of its motions,
# so no labels are needed. A natural elbow is trained on a recording of a person's arm. Both need
# `pip install "jaxik[learn]"`; the trainings here are small, so that they take a few minutes.

# %%
import os

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import jaxik
import training
from jaxik.view import draw_learning

plt.rcParams["figure.dpi"] = 80
model = jaxik.presets.iiwa14()

# %% [markdown]
# ## A policy, by energy alone
#
# The fast planner finds motions along random paths by a coarse search and Gauss-Newton steps, and a small convolutional
# network learns a correction, with gradients through the closed form. (`jaxik train policy` trains longer, and also by
# imitation of plans.)

# %%
loop = training.LoopConfig(steps=60, batch=32, validate_every=15)
trained = training.train(training.PolicyConfig(loop=loop, plans=0, validation_rows=64), arm=model)
validation = np.full(len(trained.by_energy.losses), np.nan)
for step, loss in trained.by_energy.validation:
    validation[step - 1] = loss
figure = draw_learning({"training": trained.by_energy.losses, "held out": validation})
figure.set_dpi(80)
figure

# %% [markdown]
# ## Comparison with a constant swivel
#
# Energies on held-out paths, compared with the best constant swivel of sixteen in eight branches within the limits.

# %%
paths = training.held_out_paths(model.arm, 24, seed=7, waypoints=32)
energy = jaxik.energy.joint_motion()
motion = trained.policy(paths.target, paths.time)
after = np.asarray(jax.vmap(lambda q, time: energy(model.arm, q, time))(motion.q, paths.time))

swivels = jnp.linspace(-jnp.pi, jnp.pi, 16, endpoint=False)
held = jax.vmap(lambda swivel: jaxik.solve_ik(model.arm, paths.target, jnp.full((24, 32), swivel)))(swivels)
q, ok = jnp.moveaxis(held.q, -2, 0), jnp.moveaxis(held.ok, -1, 0)  # (branch, swivel, path, waypoint, ...)
each = jnp.sum(jnp.diff(q, axis=-2) ** 2, axis=-1) / jnp.diff(paths.time)
before = np.asarray(jnp.min(jnp.where(ok.all(axis=-1), each.sum(axis=-1), jnp.inf), axis=(0, 1)))
print(
    f"{len(after)} paths: median energy {100 * (1 - np.median(after / before)):.1f} % lower, lower on {np.sum(after < before)}"
)
lower, upper = np.asarray(model.arm.lower), np.asarray(model.arm.upper)
print("postures outside joint limits:", int(((motion.q < lower - 1e-5) | (motion.q > upper + 1e-5)).any(-1).sum()))
plt.figure(figsize=(4.4, 3.4))
plt.loglog(before, after, "o", color="#2a6f97", markersize=4)
plt.axline((after.min(), after.min()), (after.max(), after.max()), color="#b8c4ce", linewidth=1)
plt.xlabel("best constant swivel [rad²/s]")
plt.ylabel("policy [rad²/s]")
for set_ticks in (plt.xticks, plt.yticks):
    set_ticks([0.3, 1, 3], ["0.3", "1", "3"])
    set_ticks([], minor=True)
plt.tight_layout()
plt.show()

# %% [markdown]
# `training.evaluate` compares a policy with the planner, before and after a few refinement steps.
#
# ## A natural elbow
#
# A recording of a person's right arm, elbow and hand relative to the shoulder, from github hai-vr/hvr-ik (Apache-2.0). It
# is not part of this project: set `JAXIK_DATA` to a folder with `human_arm/right_arm.csv`. The first four fifths are for
# training, the rest for evaluation. Errors are distances of the elbow in percent of about an arm's length.

# %%
file = os.path.join(os.environ.get("JAXIK_DATA", ""), "human_arm", "right_arm.csv")
if os.path.exists(file):
    frames = training.load_human(file)
    config = training.HumanConfig(
        members=1, loop=training.LoopConfig(steps=300, batch=128, learning_rate=2e-3, validate_every=50)
    )
    human = training.train_human(frames, config)
    names = sorted(human.scores, key=lambda name: human.scores[name].median)
    plt.figure(figsize=(6, 2.6))
    for i, name in enumerate(names):
        score = human.scores[name]
        plt.barh(i, score.median, color="#d1495b" if name == "policy" else "#b8c4ce")
        plt.text(
            score.median + 0.5, i, f"{score.median:.1f} (90th percentile {score.p90:.1f})", va="center", fontsize=8
        )
    plt.yticks(range(len(names)), names)
    plt.xlim(0, 1.6 * max(score.median for score in human.scores.values()))
    plt.xlabel("median error of the elbow [% of an arm's length]")
    plt.title(f"{frames.count} frames, the last fifth held out", fontsize=10)
    plt.tight_layout()
    plt.show()
else:
    print("no recording: set JAXIK_DATA to the folder that holds human_arm/right_arm.csv")

# %% [markdown]
# *Floor* is the error of the recorded swivel on an arm of constant lengths, a lower limit. `jaxik train human` trains the
# whole ensemble; its swivel is an input of `jaxik.solve_ik` like any other.
