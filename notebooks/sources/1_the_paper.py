# %% [markdown]
# # 1 The paper, step by step
#
# A. Losada González solves the arm of a Meccanoid geometrically: with the wrist given, the elbow lies on the intersection
# of two spheres, a circle. This notebook follows his worked example, shows where the printed numbers are wrong, and solves
# the same target by `jaxik.solve_ik`. Lengths are the paper's, without unit.

# %%
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import jaxik
from jaxik import paper
from jaxik.view import draw_construction

plt.rcParams["figure.dpi"] = 80

# %% [markdown]
# ## The target and the two spheres
#
# The shoulder is at the origin. The tip of the hand has to reach (3, 4, -3), and the hand points along +y with length 1,
# so the wrist is at (3, 3, -3). The elbow is at distance 3 from the shoulder and from the wrist: eqs. (12) to (17).

# %%
wrist, tip = np.array([3.0, 3.0, -3.0]), np.array([3.0, 4.0, -3.0])
circle = paper.elbow_circle(wrist, upper_arm=3.0, forearm=3.0)
print("plane of the circle (19):", circle.plane)
print("center M (33):", circle.center, " radius (35):", round(circle.radius, 4))
print("axes in the plane (25), (27):", circle.an1.round(2), circle.bn1.round(2))

# %% [markdown]
# ## The swivel
#
# Eq. (37) describes the circle by a parameter t, here called the *swivel*. The paper chooses t = π.

# %%
elbow = circle.point(np.pi)
print("elbow (38)-(40):", elbow.round(4))
print("distances to shoulder and wrist:", np.linalg.norm(elbow).round(12), np.linalg.norm(elbow - wrist).round(12))
draw_construction()

# %% [markdown]
# ## Printed and exact numbers
#
# `worked_example` evaluates each equation without intermediate rounding. Most printed numbers are the rounded exact ones;
# these are not:

# %%
for step in paper.worked_example():
    if step.erratum:
        printed, exact = (", ".join(f"{x:.4g}" for x in numbers) for numbers in (step.printed, step.exact))
        print(f"({step.equation}) {step.name}: printed {printed}, exact {exact} {step.unit}\n    {step.erratum}")

# %% [markdown]
# ## Effect on the tip
#
# The roll of the wrist cannot be explained by rounding. With the printed 114.11° the tip misses its target for every sign
# and zero position of the roll. The [errata](../docs/errata.md) give the reason.

# %%
misses = paper.printed_roll_misses()
plt.figure(figsize=(6, 2.6))
plt.bar([f"{'+' if sign > 0 else '-'}, {offset}°" for sign, offset in misses], list(misses.values()), color="#2a6f97")
plt.ylabel("error of the tip [hand lengths]")
plt.xlabel("sign and zero position of the roll")
plt.title(f"smallest error: {min(misses.values()):.2f}")
plt.tight_layout()
plt.show()

# %% [markdown]
# ## The same target in closed form
#
# `paper_arm()` has the paper's lengths, servo ranges and swivel reference, so its angles can be compared directly.

# %%
arm = jaxik.presets.paper_arm().arm
target = jaxik.Pointing(jnp.asarray(tip), jnp.asarray(tip - wrist))
solution = jaxik.solve_ik(arm, target, jnp.pi)
for branch in range(8):
    angles = ", ".join(f"{a:7.2f}" for a in np.degrees(solution.q[branch]))
    print(f"branch {branch}: {angles}   {jaxik.Status(int(solution.status[branch])).name}")
print("residual of branch 0:", float(solution.residual.position[0]))

# %% [markdown]
# All eight branches reach the target; only branch 0 is within the 180° ranges of the servos.
#
# Try another swivel in `solve_ik`, with `draw_construction(swivel)`, or run `jaxik view --arm paper` in a terminal.
