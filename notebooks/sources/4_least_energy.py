# %% [markdown]
# # 4 Trajectories of least energy
#
# A path says where the tool is and when. The elbow is left open; `jaxik.plan` chooses it for the least energy, inside all
# limits.

# %%
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import jaxik
from jaxik.view import draw_arm, draw_energy_map, draw_torques
from jaxik.view.alternatives import as_it_is, fixed_swivel

plt.rcParams["figure.dpi"] = 70
model = jaxik.presets.iiwa14()
path = jaxik.fit_path(jaxik.example_path("figure-eight"), model.arm)[::5]
print(f"{len(path)} waypoints, {float(path.length):.2f} m; {path.placement.describe()}")

# %% [markdown]
# ## Plan it

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
# Across: time. Up: the swivel. Color: what it costs per second to pass there with the elbow held. Grey cannot be taken.
# The plan may cross costly places, when the way around costs more: it minimizes the whole, motion of the elbow included.

# %%
fixed = fixed_swivel(model.arm, plan.trajectory)
costs = jaxik.energy_map(model.arm, path, plan.branch)
figure = draw_energy_map(costs, plan, {fixed.caption(): fixed.trajectory})
figure.set_dpi(75)
figure

# %% [markdown]
# ## How much is it worth?

# %%
for motion in (as_it_is(model.arm, plan.trajectory), fixed):
    print(f"{motion.caption():60s} {100 * (motion.energy / plan.energy - 1):+.1f} %")

# %% [markdown]
# ## Another energy, another elbow
#
# The same path for what the motors pay to hold the arm against gravity. Less movement and less holding are not the same.

# %%
holding = jaxik.energy.holding()
light = jaxik.plan(model, path, energy=holding)
paid = [float(holding(model.arm, jnp.asarray(p.trajectory.q), jnp.asarray(p.trajectory.time))) for p in (plan, light)]
print(f"planned for little motion: {paid[0]:.1f} {holding.unit}; planned for little holding: {paid[1]:.1f}")
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
# ## Faster
#
# The same postures in the shortest time that speeds and accelerations allow, from rest to rest:

# %%
quick = plan.retimed(acceleration=3.0)
print(
    f"{plan.trajectory.duration:.1f} s -> {quick.trajectory.duration:.1f} s, energy {plan.energy:.3g} -> {quick.energy:.3g} {plan.energy_unit}"
)

# %% [markdown]
# `plan.trajectory.save("eight.npz")` and `jaxik view eight.npz` show all of this moving.
