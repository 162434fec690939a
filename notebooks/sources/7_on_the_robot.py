# %% [markdown]
# # 7 Playing a trajectory on the simulated board
#
# The simulated board is a model of the real firmware in virtual time: it checks a calibration, buffers waypoints,
# interpolates, drives servos that lag, and reports their positions. The same code plays on a robot; only the address of
# the board differs.

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
# A wave from the elbow, defined in joint angles, so that no planning is needed. All angles are zero when the arm hangs down.

# %%
time = np.linspace(0.0, 4.0, 101)
lift = np.radians(50) * (1 - np.cos(np.clip(np.pi * time / 1.5, 0, np.pi))) / 2
wave = np.radians(20) * np.sin(2 * np.pi * 0.8 * time) * np.clip(time - 1.0, 0, 1)
q = np.stack([lift, 0.5 * lift, wave, 1.2 * lift, 0 * lift, 0.5 * wave], axis=1)
motion = jaxik.Trajectory(time, q, model.joint_names, model.name)

# %% [markdown]
# ## Playback
#
# The address is `"simulated"` here and `"arduino:/dev/ttyUSB0"` on a robot. `play` approaches the start, plays, holds, and
# parks.

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
# The smart servos of shoulder and elbow report their positions in turn, so a reading may be 0.1 s old. This causes the steps
# in the measured curves and most of the difference. The hobby servos of wrist and hand have no position feedback.
#
# ## Velocity limits
#
# The calibration contains the velocity limit of each joint. A faster motion is refused before anything moves:

# %%
with hardware.connect("simulated") as robot:
    refused = hardware.play(motion, robot, calibration, speed=4.0)
print(refused.result.name, "-", refused.message)

# %% [markdown]
# ## Tool error
#
# Forward kinematics converts measured and commanded angles to tool positions. For hobby servos, which have no position
# feedback, the commands are used. The errors due to lag and delayed readings are proportional to the speed.


# %%
def tool_error(log):
    """Return time [s] and distance of the measured tool from the commanded one [mm], while the trajectory plays."""
    rows = np.array([phase == "play" for phase in log.phase])
    measured = np.where(np.isfinite(log.measured), log.measured, log.commanded)[rows]
    commanded, reached = (
        np.asarray(jaxik.forward_kinematics(model.arm, q).position) for q in (log.commanded[rows], measured)
    )
    return log.time[rows] - log.time[rows][0], 1e3 * np.linalg.norm(reached - commanded, axis=1)


plt.figure(figsize=(6, 2.6))
for speed, color in ((1.0, "#d1495b"), (0.5, "#2a6f97")):
    with hardware.connect("simulated") as robot:
        log = hardware.play(motion, robot, calibration, speed=speed).log
    elapsed, error = tool_error(log)
    plt.plot(elapsed, error, color=color, label=f"speed {speed:g}: max {error.max():.0f} mm")
plt.xlabel("time [s]")
plt.ylabel("tool error [mm]")
plt.legend(frameon=False)
plt.tight_layout()
plt.show()

# %% [markdown]
# On a robot: [wiring and first power-up](../docs/wiring.md) first, then `jaxik play motion.npz --calibration yours.toml
# --board arduino:/dev/ttyUSB0 --speed 0.2`.
