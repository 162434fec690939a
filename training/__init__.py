"""Learning with the solver: elbow policies, natural elbows of people, kinematic calibration.

Calibration needs jaxik only; networks need ``pip install "jaxik[learn]"`` and are loaded on first use.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from training.calibration.calibrate import Calibration, CalibrationError, CalibrationFit, calibrate, fit_kinematics
from training.calibration.kinematic_errors import KinematicErrors, deviating_arm
from training.calibration.probe_points import ProbePoints, load_probe_points

if TYPE_CHECKING:
    from training.examples import Examples, data_mesh
    from training.human.data import HumanFrames, human_arm, load_human
    from training.human.energy import human_elbow
    from training.human.natural_elbow import NaturalElbow, load_natural_elbow, save_natural_elbow
    from training.human.training import HumanConfig, HumanScore, HumanTrained, train_human
    from training.layers import PostureNet
    from training.loop import Fitted, LoopConfig, fit
    from training.policy.evaluation import PolicyScore, evaluate, held_out_paths
    from training.policy.policy import ElbowPolicy, load_policy, make_policy, save_policy
    from training.policy.training import PolicyConfig, Trained, train

_HOMES = {
    "policy.evaluation": ("PolicyScore", "evaluate", "held_out_paths"),
    "examples": ("Examples", "data_mesh"),
    "human.data": ("HumanFrames", "human_arm", "load_human"),
    "human.energy": ("human_elbow",),
    "layers": ("PostureNet",),
    "loop": ("Fitted", "LoopConfig", "fit"),
    "human.training": ("HumanConfig", "HumanScore", "HumanTrained", "train_human"),
    "human.natural_elbow": ("NaturalElbow", "load_natural_elbow", "save_natural_elbow"),
    "policy.policy": ("ElbowPolicy", "load_policy", "make_policy", "save_policy"),
    "policy.training": ("PolicyConfig", "Trained", "train"),
}
_HOME = {name: home for home, names in _HOMES.items() for name in names}

__all__ = [
    "Calibration",
    "CalibrationError",
    "CalibrationFit",
    "ElbowPolicy",
    "Examples",
    "Fitted",
    "HumanConfig",
    "HumanFrames",
    "HumanScore",
    "HumanTrained",
    "KinematicErrors",
    "LoopConfig",
    "NaturalElbow",
    "PolicyConfig",
    "PolicyScore",
    "PostureNet",
    "ProbePoints",
    "Trained",
    "calibrate",
    "data_mesh",
    "deviating_arm",
    "evaluate",
    "fit",
    "fit_kinematics",
    "held_out_paths",
    "human_arm",
    "human_elbow",
    "load_human",
    "load_natural_elbow",
    "load_policy",
    "load_probe_points",
    "make_policy",
    "save_natural_elbow",
    "save_policy",
    "train",
    "train_human",
]


def __getattr__(name: str) -> Any:
    """Load names that need an extra on first access."""
    if name not in _HOME:
        raise AttributeError(f"module 'training' has no attribute {name!r}")
    try:
        return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    except ImportError as error:
        if error.name in ("equinox", "orbax", "orbax.checkpoint"):
            from jaxik.errors import MissingExtraError

            raise MissingExtraError('learning needs equinox and orbax: pip install "jaxik[learn]"') from error
        raise
