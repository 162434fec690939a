"""The fast planner: motions of many paths at once, in single precision, within a thousandth of a plan's time."""

from jaxik.planning.fast.candidates import Candidate, best_candidate
from jaxik.planning.fast.knots import KNOTS
from jaxik.planning.fast.path_batch import (
    EXCESS,
    Correction,
    PathBatch,
    StartPostures,
    SwivelPath,
    no_start,
    path_batch,
    steps,
)
from jaxik.planning.fast.planner import CANDIDATES, BatchMotion, motion_weights, plan_batch

__all__ = [
    "CANDIDATES",
    "EXCESS",
    "KNOTS",
    "BatchMotion",
    "Candidate",
    "Correction",
    "PathBatch",
    "StartPostures",
    "SwivelPath",
    "best_candidate",
    "motion_weights",
    "no_start",
    "path_batch",
    "plan_batch",
    "steps",
]
