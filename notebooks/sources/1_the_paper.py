# %% [markdown]
# # 1 The paper, step by step
#
# A. Losada González solves the arm of a Meccanoid by geometry: take the hand off, and the elbow lies on the circle in
# which two spheres meet. This notebook walks his worked example, shows where the printed numbers are off, and ends with
# the same target solved by `jaxik.solve_ik`. Lengths are the paper's, without unit.

# %%
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import jaxik
from jaxik import paper
from jaxik.paper import formulas
from jaxik.view import draw_construction

plt.rcParams["figure.dpi"] = 80

# %% [markdown]
# ## The target and the two spheres
#
# The shoulder is the origin. The hand's tip has to be at (3, 4, -3), the hand points along +y and is 1 long, so the wrist
# is at (3, 3, -3). The elbow is 3 away from the shoulder and 3 away from the wrist: eqs. (12) to (17).

# %%
wrist, tip = np.array([3.0, 3.0, -3.0]), np.array([3.0, 4.0, -3.0])
circle = formulas.elbow_circle(wrist, upper_arm=3.0, forearm=3.0)
print("plane of the circle (19):", circle.plane)
print("center M (33):", circle.center, " radius (35):", round(circle.radius, 4))
print("axes in the plane (25), (27):", circle.an1.round(2), circle.bn1.round(2))

# %% [markdown]
# ## The elbow, chosen by one number
#
# Eq. (37) goes around the circle with a parameter t, here called the *swivel*. The paper takes t = π.

# %%
elbow = circle.point(np.pi)
print("elbow (38)-(40):", elbow.round(4))
print("distances to shoulder and wrist:", np.linalg.norm(elbow).round(12), np.linalg.norm(elbow - wrist).round(12))
draw_construction()

# %% [markdown]
# ## Every printed number against the exact one
#
# `worked_example` computes each equation without rounding on the way. Most printed numbers are roundings; these are not:

# %%
for step in paper.worked_example():
    if step.erratum:
        printed, exact = (", ".join(f"{x:.4g}" for x in numbers) for numbers in (step.printed, step.exact))
        print(f"({step.equation}) {step.what}: printed {printed}, exact {exact} {step.unit}\n    {step.erratum}")

# %% [markdown]
# ## Why it matters
#
# The roll of the wrist is the one that cannot be explained by rounding. With the printed 114.11° the tip misses its target
# whatever sign and zero position one reads into it. (Why, is in [the errata](../docs/errata.md).)

# %%
misses = paper.printed_roll_misses()
plt.figure(figsize=(6, 2.6))
plt.bar([f"{'+' if sign > 0 else '-'}, {offset}°" for sign, offset in misses], list(misses.values()), color="#2a6f97")
plt.ylabel("tip's miss [hand lengths]")
plt.xlabel("sign and zero position of the roll")
plt.title(f"The best reading still misses by {min(misses.values()):.2f}")
plt.tight_layout()
plt.show()

# %% [markdown]
# ## The same target in closed form
#
# `paper_arm()` has the paper's lengths, servo ranges and swivel, so its angles read off directly.

# %%
arm = jaxik.presets.paper_arm().arm
target = jaxik.Pointing(jnp.asarray(tip), jnp.asarray(tip - wrist))
solution = jaxik.solve_ik(arm, target, jnp.pi)
for branch in range(8):
    angles = ", ".join(f"{a:7.2f}" for a in np.degrees(solution.q[branch]))
    print(f"branch {branch}: {angles}   {jaxik.Status(int(solution.status[branch])).name}")
print("residual of branch 0:", float(solution.residual.position[0]))

# %% [markdown]
# Only branch 0 respects the 180° servos. All eight reach the target.
#
# Try: another swivel in `solve_ik`, and `draw_construction(swivel)` to see it; or `jaxik view --arm paper` in a terminal.
