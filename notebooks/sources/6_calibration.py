# %% [markdown]
# # 6 Calibration
#
# A built arm is not its drawing: lengths are off by millimeters, joints read zero a degree beside zero. Touch some points
# whose places are known, note what the joints read, and `training.calibrate` finds the deviations, with their standard
# errors, and says what the touches cannot tell.

# %%
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import jaxik
import training

jax.config.update("jax_enable_x64", True)
plt.rcParams["figure.dpi"] = 80
model = jaxik.presets.meccanoid("right")
arm = model.arm
rng = np.random.default_rng(3)

# %% [markdown]
# ## An arm that is not what it should be
#
# Here the true arm is made up, so that what is found can be compared with it: a forearm 2 % too long, joints that read
# zero up to two degrees beside zero. Measurements have noise of half a millimeter, and two of them are plain wrong.

# %%
truth = training.KinematicErrors(
    length=jnp.array([0.01, 0.02, -0.015]),
    shift=jnp.zeros(3),
    turn=jnp.zeros(3),
    zero=jnp.radians(jnp.array([1.0, -2.0, 1.5, 0.5, -1.0, 2.0])),
    scale=jnp.zeros(6),
)
real = training.deviating_arm(arm, truth)
lower, upper = np.asarray(arm.lower), np.asarray(arm.upper)
reading = rng.uniform(lower + 0.1 * (upper - lower), upper - 0.1 * (upper - lower), (40, 6))
tip = np.asarray(jaxik.forward_kinematics(real, reading).position) + 5e-4 * rng.normal(size=(40, 3))
tip[[7, 23]] += 0.05
before = 1e3 * np.linalg.norm(np.asarray(jaxik.forward_kinematics(arm, reading).position) - tip, axis=1)
print(f"the drawing misses the touches by {np.median(before):.1f} mm in the median")

# %% [markdown]
# ## Calibrate
#
# We look for lengths and zeros, and leave mount and scales alone.

# %%
found = training.calibrate(model, reading, tip, fit=("lengths", "zeros"))
print("left out as plain wrong: touches", found.outliers)
print(f"noise found: {1e3 * found.noise:.2f} mm (made with 0.50)")
for name, value, error, true in zip(
    found.names, found.errors.flat(), found.deviation.flat(), truth.flat(), strict=True
):
    if value or true:
        unit, factor = ("%", 100.0) if name.startswith("length") else ("°", 180 / np.pi)
        print(f"{name:32s} {factor * value:7.3f} ± {factor * error:.3f} {unit}   (true {factor * true:.3f})")

# %% [markdown]
# ## What it is worth
#
# New postures, not used in the fit: how far is the tool from where the model says?

# %%
fresh = rng.uniform(lower, upper, (400, 6))
asked = np.asarray(jaxik.forward_kinematics(real, fresh).position)
misses = {
    "as drawn": np.asarray(jaxik.forward_kinematics(arm, fresh).position),
    "calibrated": np.asarray(jaxik.forward_kinematics(found.model.arm, found.angles(fresh)).position),
}
plt.figure(figsize=(6, 2.8))
for (name, points), color in zip(misses.items(), ("#d1495b", "#2a6f97"), strict=True):
    off = 1e3 * np.linalg.norm(points - asked, axis=1)
    plt.hist(
        off, bins=np.geomspace(0.02, 50, 40), alpha=0.8, color=color, label=f"{name}: median {np.median(off):.2f} mm"
    )
plt.xscale("log")
plt.xlabel("tool off by [mm]")
plt.ylabel("postures of 400")
plt.legend(frameon=False)
plt.tight_layout()
plt.show()

# %% [markdown]
# ## Too little to go by
#
# Touches in one corner of the workspace hardly tell lengths from zeros. The answer is not better than they are, and says
# so: compare the standard errors.

# %%
corner = np.asarray(0.5 * (lower + upper)) + np.radians(8) * rng.normal(size=(40, 6))
seen = np.asarray(jaxik.forward_kinematics(real, corner).position) + 5e-4 * rng.normal(size=(40, 3))
vague = training.calibrate(model, corner, seen, fit=("lengths", "zeros"))
for name, narrow, wide in zip(found.names, found.deviation.flat(), vague.deviation.flat(), strict=True):
    if np.isfinite(narrow) and narrow > 0:
        unit, factor = ("%", 100.0) if name.startswith("length") else ("°", 180 / np.pi)
        print(f"{name:32s} ± {factor * narrow:.3f} {unit} all over, ± {factor * wide:.3f} {unit} in the corner")

# %% [markdown]
# `jaxik.save_model(found.model, "mine.json")` keeps it; every command takes it with `--arm mine.json`.
