"""Outcomes of a solve, in words."""

import enum


class Status(enum.IntEnum):
    """Outcome of one branch of one row; larger is worse, and the worst that applies is reported.

    OK and NEAR_SINGULAR promise joint angles exactly within the limits, and the tool on the target within 4e-6 rad and
    arm lengths (1.05e-3 in float32); far closer, to rounding, unless an angle was put on its limit or the rotation is
    one to six decimals only.
    """

    OK = 0
    NEAR_SINGULAR = 1
    LIMITS = 2
    KEEP_OUT = 3
    COLLISION = 4
    ORIENTATION = 5
    OUT_OF_REACH = 6
    UNSOLVED = 7
    DUPLICATE = 8
    INVALID_TARGET = 9
    NONFINITE_INPUT = 10

    @property
    def message(self) -> str:
        """Meaning of the status and the next step to take, in one sentence."""
        return _MESSAGES[self]


_MESSAGES = {
    Status.OK: "the posture reaches the target within all limits",
    Status.NEAR_SINGULAR: "the posture reaches the target close to a singular one, where joint speeds grow "
    "without bound",
    Status.LIMITS: "the posture reaches the target but exceeds a joint limit; try another branch, or another swivel "
    "(jaxik.swivel_arcs)",
    Status.KEEP_OUT: "the posture reaches the target with the elbow in its keep-out; try another swivel "
    "(jaxik.swivel_arcs)",
    Status.COLLISION: "the posture reaches the target, but the arm's body meets an obstacle or itself "
    "(jaxik.clearance says which); try another branch, or another swivel (jaxik.swivel_arcs with world=)",
    Status.ORIENTATION: "the wrist is in reach, but the forearm cannot turn to fit the hand's orientation; q is the "
    "posture that comes closest; try another angle of the outer joint (jaxik.swivel_arcs)",
    Status.OUT_OF_REACH: "target out of reach: the wrist is too far from or too close to the shoulder; q is the "
    "closest reachable posture on that ray",
    Status.UNSOLVED: "refinement found no solution here: there is none, or the target is out of reach; q is where it "
    "stopped; try another branch, or another angle of the outer joint",
    Status.DUPLICATE: "the posture is that of another slot; use that one",
    Status.INVALID_TARGET: "the rotation is not a rotation matrix to 2e-6 (3.6e-5 in float32; jaxik.nearest_rotation "
    "mends it), the direction has no length or is one that this arm cannot point in, or the swivel exceeds 1e6 rad "
    "(1e3 in float32)",
    Status.NONFINITE_INPUT: "NaN or infinity in the target, the swivel or the present posture; q is a placeholder",
}
