# %% [markdown]
# # 8 A plan in MuJoCo and MJX
#
# `jaxik.plan` knows the arm as geometry with limits. Here a plan is replayed with physics: masses, gravity, and servos with
# the arm's torque limits, first in MuJoCo, then in MJX, which runs MuJoCo's physics in JAX. Needs
# `pip install 'jaxik[mujoco]' mujoco-mjx`.

# %%
import contextlib
import io

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import mujoco
import numpy as np
from scipy.interpolate import CubicSpline

import jaxik

with contextlib.redirect_stdout(io.StringIO()):  # it says that NVIDIA's warp is missing, which it does not need
    from mujoco import mjx

plt.rcParams["figure.dpi"] = 70
model = jaxik.presets.iiwa14()
path = jaxik.fit_path(model.arm, jaxik.example_path("figure-eight"))[::5]
plan = jaxik.plan(model, path)
motion = plan.trajectory
print(f"{len(path)} waypoints in {motion.duration:.1f} s, planned with a gap of {100 * plan.gap:.1f} %")

# %% [markdown]
# ## MuJoCo
#
# `to_mjcf` writes the arm with a position servo per joint. A servo that is told where the arm should be *now* lags behind by
# twice the time constant; one that is told where it should be that much later does not. What is left comes from
# accelerations, of which the servos are not told.

# %%
BANDWIDTH = 60.0  # rad/s
simulated = mujoco.MjModel.from_xml_string(jaxik.to_mjcf(model, bandwidth=BANDWIDTH))
simulated.opt.timestep = 0.004
steps = int(motion.duration / simulated.opt.timestep)
time = motion.time[0] + simulated.opt.timestep * np.arange(1, steps + 1)


spline = CubicSpline(motion.time, motion.q)  # smooth between waypoints, as a ROS 2 controller plays it


def commands(ahead=0.0):
    """Joint angles to send to the servos at every step of the simulation."""
    return spline(np.minimum(time + ahead, motion.time[-1]))


speed = spline(motion.time[0], 1)  # the path begins at full speed


def replay(simulated, control):
    """Joint angles and torques of the simulated arm after every step."""
    data = mujoco.MjData(simulated)
    data.qpos[:], data.qvel[:] = motion.q[0], speed
    q, torque = np.empty((2, *control.shape))
    for k, wanted in enumerate(control):
        data.ctrl[:] = wanted
        mujoco.mj_step(simulated, data)
        q[k], torque[k] = data.qpos, data.qfrc_actuator
    return q, torque


def tool_error(q, wanted):
    """Distance of the tool from where the plan has it [mm]."""
    tools = [jaxik.forward_kinematics(model.arm, angles).position for angles in (q, wanted)]
    return 1e3 * np.linalg.norm(np.asarray(tools[0]) - np.asarray(tools[1]), axis=-1)


wanted = commands()
played = {}
for name, ahead in (("now", 0.0), ("2 time constants ahead", 2 / BANDWIDTH)):
    q, torque = replay(simulated, commands(ahead))
    played[name] = q
    share = np.abs(torque).max(0) / np.asarray(model.arm.torque_limit)
    error = tool_error(q, wanted)
    print(f"told {name:22s}: tool off by {error.mean():.1f} mm on average, {error.max():.1f} mm at most;", end=" ")
    print(f"torques up to {100 * share.max():.0f} % of the limits")

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 2.8))
for name, q in played.items():
    left.plot(time, tool_error(q, wanted), label=f"told {name}")
left.set(xlabel="time [s]", ylabel="tool error [mm]")
left.legend(frameon=False, fontsize=8, loc="upper left")
right.plot(time, np.degrees(q - wanted), label=model.joint_names)
right.set(xlabel="time [s]", ylabel="joint error, ahead [°]")
right.legend(frameon=False, fontsize=7, loc="center left", bbox_to_anchor=(1, 0.5))
figure.tight_layout()
plt.show()

# %% [markdown]
# ## MJX: many arms at once
#
# The same model, the same servos, in JAX: `vmap` replays the plan with loads that the servos do not know of, from none to
# 4 kg in the hand, in one program. MJX computes in single precision here.

# %%
loads = jnp.linspace(0.0, 4.0, 8)  # kg
in_jax = mjx.put_model(simulated)
hand = simulated.nbody - 1


def replay_loaded(load, control):
    """Joint angles after every step, with a mass added to the last link."""
    loaded = in_jax.replace(body_mass=in_jax.body_mass.at[hand].add(load))
    data = mjx.make_data(in_jax).replace(qpos=jnp.float32(motion.q[0]), qvel=jnp.float32(speed))

    def step(data, wanted):
        data = mjx.step(loaded, data.replace(ctrl=wanted))
        return data, data.qpos

    return jax.lax.scan(step, data, control)[1]


# MJX's programs are long: on a CPU these options compile them in 5 s instead of 20 s.
quickly = {"xla_cpu_use_fusion_emitters": False, "xla_backend_optimization_level": 1}
many = jax.jit(jax.vmap(replay_loaded, in_axes=(0, None)), compiler_options=quickly)
loaded = np.asarray(many(loads, jnp.float32(commands(2 / BANDWIDTH))))
print(f"{len(loads)} arms, {steps} steps each")
print(f"MJX without a load and MuJoCo differ by {np.abs(loaded[0] - q).max():.0e} rad at most")

# %%
plt.figure(figsize=(6, 2.8))
for load, angles in zip(loads[::2], loaded[::2], strict=True):
    plt.plot(time, tool_error(angles, wanted), label=f"{float(load):.1f} kg")
plt.xlabel("time [s]")
plt.ylabel("tool error [mm]")
plt.legend(frameon=False, title="unknown load")
plt.tight_layout()
plt.show()
