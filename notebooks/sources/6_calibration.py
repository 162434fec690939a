# %% [markdown]
# # 6 Calibration
#
# A real arm deviates from its drawing: lengths by millimeters, joint zeros by degrees. From probe points with known
# positions and the joint readings there, `training.calibrate` estimates these deviations with their standard errors, and
# reports which of them the probe points do not determine.

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
# ## A simulated arm
#
# The true arm is simulated, so that the result can be compared with it: a forearm 2 % too long, and joint zeros wrong by up
# to two degrees. Measurements have a noise of 0.5 mm, and two of them are outliers.

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
print(f"nominal arm: median error {np.median(before):.1f} mm")

# %% [markdown]
# ## Calibrate
#
# Fit lengths and zeros; mount and scales are held at their nominal values.

# %%
found = training.calibrate(model, reading, tip, fit=("lengths", "zeros"))
print("rejected outliers: probe points", found.outliers)
print(f"estimated noise: {1e3 * found.noise:.2f} mm (true 0.50)")
for name, value, error, true in zip(
    found.names, found.errors.flat(), found.deviation.flat(), truth.flat(), strict=True
):
    if value or true:
        unit, factor = ("%", 100.0) if name.startswith("length") else ("°", 180 / np.pi)
        print(f"{name:32s} {factor * value:7.3f} ± {factor * error:.3f} {unit}   (true {factor * true:.3f})")

# %% [markdown]
# ## Accuracy
#
# Error of the tool at new postures, which were not used in the fit:

# %%
fresh = rng.uniform(lower, upper, (400, 6))
true_tip = np.asarray(jaxik.forward_kinematics(real, fresh).position)
predictions = {
    "nominal": np.asarray(jaxik.forward_kinematics(arm, fresh).position),
    "calibrated": np.asarray(jaxik.forward_kinematics(found.model.arm, found.angles(fresh)).position),
}
plt.figure(figsize=(6, 2.8))
for (name, points), color in zip(predictions.items(), ("#d1495b", "#2a6f97"), strict=True):
    off = 1e3 * np.linalg.norm(points - true_tip, axis=1)
    plt.hist(
        off, bins=np.geomspace(0.02, 50, 40), alpha=0.8, color=color, label=f"{name}: median {np.median(off):.2f} mm"
    )
plt.xscale("log")
plt.xlabel("error of the tool [mm]")
plt.ylabel("postures of 400")
plt.legend(frameon=False)
plt.tight_layout()
plt.show()

# %% [markdown]
# ## Insufficient data
#
# Probe points in one corner of the workspace hardly separate lengths from zeros. The standard errors show this:

# %%
corner = np.asarray(0.5 * (lower + upper)) + np.radians(8) * rng.normal(size=(40, 6))
corner_tip = np.asarray(jaxik.forward_kinematics(real, corner).position) + 5e-4 * rng.normal(size=(40, 3))
vague = training.calibrate(model, corner, corner_tip, fit=("lengths", "zeros"))
for name, narrow, wide in zip(found.names, found.deviation.flat(), vague.deviation.flat(), strict=True):
    if np.isfinite(narrow) and narrow > 0:
        unit, factor = ("%", 100.0) if name.startswith("length") else ("°", 180 / np.pi)
        print(f"{name:32s} ± {factor * narrow:.3f} {unit} everywhere, ± {factor * wide:.3f} {unit} in the corner")

# %% [markdown]
# `jaxik.save_model(found.model, "mine.json")` saves the arm; every command accepts it as `--arm mine.json`.
