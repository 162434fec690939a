"""The paper's worked example, equation by equation, compared with exact results of the same geometry.

Source of every printed number and of the equation numbers: A. Losada González, "Three-dimensional geometric resolution
of the inverse kinematics of a 7 degree of freedom articulated arm", Universidad de Vigo. ``python -m jaxik.paper``
prints the comparison as a table; ``docs/errata.md`` lists the errors and the formulas used in their place.
"""

from jaxik.paper.formulas import (
    ArmPoints,
    Circle,
    ShoulderAngles,
    chain,
    elbow_circle,
    elbow_from_shoulder_angles,
    forearm_roll,
    interior_wrist_angle,
    line_plane_angle,
    printed_shoulder_angles,
    shoulder_angles,
    wrist_from_hand,
)
from jaxik.paper.report import printed_roll_miss, printed_roll_misses, solve_example, solved_miss, table
from jaxik.paper.steps import EXAMPLE, ExampleData, Step, worked_example

__all__ = [
    "EXAMPLE",
    "ArmPoints",
    "Circle",
    "ExampleData",
    "ShoulderAngles",
    "Step",
    "chain",
    "elbow_circle",
    "elbow_from_shoulder_angles",
    "forearm_roll",
    "interior_wrist_angle",
    "line_plane_angle",
    "printed_roll_miss",
    "printed_roll_misses",
    "printed_shoulder_angles",
    "shoulder_angles",
    "solve_example",
    "solved_miss",
    "table",
    "worked_example",
    "wrist_from_hand",
]
