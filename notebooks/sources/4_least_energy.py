# %% [markdown]
# # 4 Trajectories of least energy
#
# A path prescribes the tool over time and leaves the elbow free. `jaxik.plan` chooses the elbow for the least energy within
# all limits.

# %%
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import jaxik
from jaxik.view import draw_arm, draw_energy_map, draw_torques
from jaxik.view.alternatives import fixed_swivel, given_motion

plt.rcParams["figure.dpi"] = 70
model = jaxik.presets.iiwa14()
path = jaxik.fit_path(model.arm, jaxik.example_path("figure-eight"))[::5]
print(f"{len(path)} waypoints, {float(path.length):.2f} m; {path.placement.describe()}")

# %% [markdown]
# ## Plan

# %%
plan = jaxik.plan(model, path)
print(plan.report())

# %%
figure = draw_arm(model, plan.trajectory, path)
figure.set_dpi(75)
figure

# %% [markdown]
# ## The energy map
#
# The color is the cost per second at a given time and a constant swivel; gray is infeasible. The plan minimizes the energy
# of the whole motion, including that of the elbow, so it may pass through regions of high cost.

# %%
fixed = fixed_swivel(model.arm, plan.trajectory)
costs = jaxik.energy_map(model.arm, path, plan.branch)
figure = draw_energy_map(costs, plan, {fixed.caption(): fixed.trajectory})
figure.set_dpi(75)
figure

# %% [markdown]
# ## Comparison

# %%
for motion in (given_motion(model.arm, plan.trajectory), fixed):
    print(f"{motion.caption():60s} {100 * (motion.energy / plan.energy - 1):+.1f} %")

# %% [markdown]
# ## Another energy
#
# The same path, planned for the least holding torques against gravity. The two energies have different minima.

# %%
holding = jaxik.energy.holding()
light = jaxik.plan(model, path, energy=holding)
values = [float(holding(model.arm, jnp.asarray(p.trajectory.q), jnp.asarray(p.trajectory.time))) for p in (plan, light)]
print(f"holding torque: {values[0]:.1f} {holding.unit} if planned for joint motion, {values[1]:.1f} if planned for it")
plt.figure(figsize=(6, 2.6))
for p, name in ((plan, "joint motion"), (light, "holding")):
    plt.plot(p.trajectory.time, np.degrees(np.unwrap(p.swivel)), label=name)
plt.xlabel("time [s]")
plt.ylabel("swivel [°]")
plt.legend(frameon=False)
plt.tight_layout()
plt.show()

# %%
figure = draw_torques(model, light.trajectory)
figure.set_dpi(65)
figure

# %% [markdown]
# ## A closed path
#
# The figure eight ends where it begins, but the arm does not: its elbow has drifted. `end="start"` plans a motion that can be
# repeated for ever.

# %%
closed = jaxik.plan(model, path, end="start")
for name, p in (("open", plan), ("closed", closed)):
    away = np.degrees(np.abs(p.trajectory.q[-1] - p.trajectory.q[0]).max())
    print(
        f"{name:6s} ends {away:.1f}° from where it began; energy {p.energy:.4g} {p.energy_unit}, gap {100 * p.gap:.1f} %"
    )

# %% [markdown]
# ## Retiming
#
# The same postures in the shortest time within velocity and acceleration limits, from rest to rest:

# %%
quick = plan.retimed(acceleration=3.0)
print(
    f"{plan.trajectory.duration:.1f} s -> {quick.trajectory.duration:.1f} s, energy {plan.energy:.3g} -> {quick.energy:.3g} {plan.energy_unit}"
)

# %% [markdown]
# `plan.trajectory.save("eight.npz")` and `jaxik view eight.npz` show the motion.
