"""``jaxik train policy``, ``train human`` and ``calibrate geometry``."""

import math
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro

from jaxik import energy as energies
from jaxik.arm import save_model
from jaxik.cli.console import Screen
from jaxik.cli.inputs import find_arm
from training.calibration.calibrate import GROUPS, Calibration
from training.calibration.calibrate import calibrate as calibrate_arm
from training.calibration.probe_points import load_touches

_ENERGIES = {"joint-motion": energies.joint_motion, "holding": energies.holding, "servo": energies.servo}


def calibrate_geometry(
    touches: Annotated[Path, tyro.conf.Positional],
    arm: str = "meccanoid-right",
    out: Path = Path("calibrated.json"),
    fit: tuple[str, ...] = GROUPS,
    json: bool = False,
) -> int:
    """Calibrate lengths, mount, joint zeros and scales from measured tips, and write an arm model file.

    Args:
        touches: Table (.csv) of joint readings and tips: joints by name or q1, q2, ... (_deg for degrees), and x, y, z.
        arm: Nominal arm: a preset (meccanoid-right, meccanoid-left, iiwa7, iiwa14, paper) or model file (.json).
        out: Model file to write; every command takes it with --arm.
        fit: What to fit: lengths, mount, zeros, scales.
        json: Print one JSON document instead of tables.
    """
    screen = Screen(json)
    model = find_arm(arm)
    data = load_touches(touches, model.joint_names)
    with screen.step(f"fitting {len(data.tip)} touches"):
        found = calibrate_arm(model, data.q, data.tip, fit=fit)
    save_model(found.model, out)
    rows = [
        (name, *_shown(name, float(value), float(error)))
        for name, value, error in zip(found.names, found.errors.flat(), found.deviation.flat(), strict=True)
        if value != 0.0 or error != 0.0
    ]
    screen.table("deviations from the nominal arm", ("", "deviation", "standard error"), rows)
    for text in found.undetermined:
        screen.say(f"not determined by these touches: {text}; held at the nominal value")
    if found.outliers:
        screen.say(f"left out as outliers: touches {', '.join(str(i + 1) for i in found.outliers)}")
    screen.say(f"noise {1e3 * found.noise:.2f} mm per coordinate; angles are readings times 1 + scale")
    screen.say(f"saved {out}: use it with --arm {out}")
    screen.result(_facts(found, out))
    return 0


def train_policy(
    arm: str = "iiwa14",
    out: Path = Path("elbow.policy"),
    energy: Literal["joint-motion", "holding", "servo"] = "joint-motion",
    steps: int | None = None,
    plans: int | None = None,
    seed: int = 0,
    folder: Path | None = None,
    json: bool = False,
) -> int:
    """Train an elbow policy for an arm: by energy through the closed form, then from the planner's plans.

    Args:
        arm: Preset (meccanoid-right, meccanoid-left, iiwa7, iiwa14, paper) or model file (.json).
        out: Policy file to write.
        energy: What to make small: joint-motion, holding or servo.
        steps: Of the training by energy; more than the default for a better policy.
        plans: How many plans to imitate afterwards; 0 for none.
        seed: One seed, one policy.
        folder: For checkpoints and metrics; a run that finds its own there continues.
        json: Print one JSON document instead of text.
    """
    from training.policy.evaluation import evaluate, held_out_paths
    from training.policy.policy import save_policy
    from training.policy.training import PolicyConfig, train

    screen = Screen(json)
    model, wanted = find_arm(arm), _ENERGIES[energy]()
    config = PolicyConfig(seed=seed, folder=folder).sized(steps, plans)
    with screen.step(f"training a policy for {model.name}") as bar:
        shares = {"by energy": (0.0, 0.6), "plans": (0.6, 0.2), "from plans": (0.8, 0.2)}
        trained = train(config, model, wanted, progress=lambda s, x: bar(shares[s][0] + shares[s][1] * x))
    save_policy(trained.policy, out)
    with screen.step("evaluating on held-out paths"):
        score = evaluate(trained.policy, held_out_paths(model.arm, 128, seed=seed + 1), energy=wanted)
    screen.say(score.report())
    screen.say(f"saved {out}")
    screen.result({"file": str(out), **score.facts()})
    return 0


def train_human(
    recording: Annotated[Path, tyro.conf.Positional],
    out: Path = Path("human.policy"),
    held_out: float = 0.2,
    seed: int = 0,
    folder: Path | None = None,
    json: bool = False,
) -> int:
    """Train a natural elbow on recorded human arms.

    Args:
        recording: Table (.csv) with the columns elbow_x .. hand_qw, see docs/learning.md.
        out: Policy file to write; `training.load_natural_elbow` reads it, `training.human_elbow` makes it an energy.
        held_out: Share of the recording, at its end, to evaluate on.
        seed: One seed, one policy.
        folder: For checkpoints and metrics; a run that finds its own there continues.
        json: Print one JSON document instead of the table.
    """
    from training.human.data import load_human
    from training.human.training import HumanConfig
    from training.human.training import train_human as train_on

    screen = Screen(json)
    frames = load_human(recording)
    with screen.step(f"training on {frames.count} frames") as bar:
        trained = train_on(frames, HumanConfig(seed=seed, held_out=held_out).stored(folder), progress=bar)
    trained.policy.save(out)
    rows = [(name, f"{s.median:.1f}", f"{s.p90:.1f}") for name, s in trained.scores.items()]
    title = f"elbow error on the last {held_out:.0%} of the recording, % of its length unit"
    screen.table(title, ("", "median", "90th percentile"), rows)
    screen.say(f"saved {out}")
    screen.result({"file": str(out), "scores": {name: [s.median, s.p90] for name, s in trained.scores.items()}})
    return 0


def _shown(name: str, value: float, error: float) -> tuple[str, str]:
    """A deviation and its standard error in a person's units."""
    factor, unit = 100.0, "%"
    if name.startswith("shoulder"):
        factor, unit = 1e3, "mm"
    elif name.startswith(("mount", "zero")):
        factor, unit = 180 / math.pi, "°"
    return f"{factor * value:+.3f} {unit}", "not determined" if math.isinf(error) else f"{factor * error:.3f} {unit}"


def _facts(found: Calibration, out: Path) -> dict[str, object]:
    error = np.asarray(found.deviation.flat())
    return {
        "file": str(out),
        "deviation": dict(zip(found.names, np.asarray(found.errors.flat()).tolist(), strict=True)),
        "standard_error": {n: float(e) if np.isfinite(e) else None for n, e in zip(found.names, error, strict=True)},
        "undetermined": list(found.undetermined),
        "noise": found.noise,
        "outliers": list(found.outliers),
    }
