# %% [markdown]
# # 7 Playing it out on the simulated robot
#
# The simulated board is a model of the real firmware in virtual time: it checks a calibration, buffers waypoints,
# interpolates, drives servos that lag, and reports where they are. What runs here runs on the robot with another address.

# %%
import matplotlib.pyplot as plt
import numpy as np

import hardware
import jaxik
from jaxik.view import draw_tracking

plt.rcParams["figure.dpi"] = 70
model = jaxik.presets.meccanoid("right")
calibration = hardware.load_joint_map("meccanoid.toml")
print(calibration.robot, "with", len(calibration.joints), "joints")

# %% [markdown]
# ## A motion
#
# Wave from the elbow: made directly in joint angles, so nothing has to be planned. Angles are zero where the arm hangs.

# %%
time = np.linspace(0.0, 4.0, 101)
lift = np.radians(50) * (1 - np.cos(np.clip(np.pi * time / 1.5, 0, np.pi))) / 2
wave = np.radians(20) * np.sin(2 * np.pi * 0.8 * time) * np.clip(time - 1.0, 0, 1)
q = np.stack([lift, 0.5 * lift, wave, 1.2 * lift, 0 * lift, 0.5 * wave], axis=1)
motion = jaxik.Trajectory(time, q, model.joint_names, model.name)

# %% [markdown]
# ## Play it
#
# `hardware.connect("simulated")` here; `"arduino:/dev/ttyUSB0"` on the robot. `play` eases in, plays, holds, and parks.

# %%
with hardware.connect("simulated") as robot:
    report = hardware.play(motion, robot, calibration)
print(report.result.name, "-", report.message)
for note in report.warnings:
    print("note:", note)

# %%
figure = draw_tracking(report.log)
figure.set_dpi(70)
figure

# %% [markdown]
# The smart servos of shoulder and elbow report where they are, in turn, so that a reading may be a tenth of a second old:
# the steps in the measured curves, and most of the difference. Hobby servos of wrist and hand say nothing.
#
# ## Too fast
#
# The calibration knows how fast each servo may be. What is faster is refused before anything moves:

# %%
with hardware.connect("simulated") as robot:
    refused = hardware.play(motion, robot, calibration, speed=4.0)
print(refused.result.name, "-", refused.message)

# %% [markdown]
# ## Where did the hand go?
#
# Measured angles through forward kinematics, against what was asked. Hobby servos report nothing, so their commands
# stand in. Lag and old readings are proportional to speed: at half the speed half of it remains.


# %%
def tool_error(log):
    """Time [s] and how far the measured tool is from the commanded one [mm], while the trajectory plays."""
    rows = np.array([phase == "play" for phase in log.phase])
    measured = np.where(np.isfinite(log.measured), log.measured, log.commanded)[rows]
    asked, went = (np.asarray(jaxik.forward_kinematics(model.arm, q).position) for q in (log.commanded[rows], measured))
    return log.time[rows] - log.time[rows][0], 1e3 * np.linalg.norm(went - asked, axis=1)


plt.figure(figsize=(6, 2.6))
for speed, color in ((1.0, "#d1495b"), (0.5, "#2a6f97")):
    with hardware.connect("simulated") as robot:
        log = hardware.play(motion, robot, calibration, speed=speed).log
    at_s, off = tool_error(log)
    plt.plot(at_s, off, color=color, label=f"speed {speed:g}: at most {off.max():.0f} mm")
plt.xlabel("time [s]")
plt.ylabel("tool off by [mm]")
plt.legend(frameon=False)
plt.tight_layout()
plt.show()

# %% [markdown]
# On a robot: [wiring and first power-up](../docs/wiring.md) first, then `jaxik play motion.npz --calibration yours.toml
# --board arduino:/dev/ttyUSB0 --speed 0.2`.
