"""The freedom that a target leaves: the swivel, its feasible arcs, and the nearest posture."""

from jaxik.redundancy.arcs import SwivelArcs, swivel_arcs
from jaxik.redundancy.nearest import NearestSolution, solve_nearest
from jaxik.redundancy.swivel import swivel_of
from jaxik.redundancy.swivel_functions import swivel_functions, triple_angles

__all__ = [
    "NearestSolution",
    "SwivelArcs",
    "solve_nearest",
    "swivel_arcs",
    "swivel_functions",
    "swivel_of",
    "triple_angles",
]
