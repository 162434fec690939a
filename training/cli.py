"""``jaxik train policy``, ``train human`` and ``calibrate geometry``."""

import math
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro

from jaxik.arm import save_model
from jaxik.cli import ENERGIES, Screen, find_arm
from training.calibration.calibrate import GROUPS, Calibration
from training.calibration.calibrate import calibrate as calibrate_arm
from training.calibration.probe_points import load_probe_points


def calibrate_geometry(
    points: Annotated[Path, tyro.conf.Positional],
    arm: str = "meccanoid-right",
    base: str | None = None,
    tip: str | None = None,
    out: Path = Path("calibrated.json"),
    fit: tuple[str, ...] = GROUPS,
    json: bool = False,
) -> int:
    """Calibrate lengths, mount, joint zeros and scales from measured tip positions, and write an arm model file.

    Args:
        points: Probe points (.csv): joints by name or as q1, q2, ... (_deg for degrees), and the tip as x, y, z.
        arm: Nominal arm: preset (`jaxik info` lists them), model file (.json), URDF (.urdf) or MJCF (.xml).
        base: Base link in a URDF; not needed, as the tip, if it has one arm (see `jaxik info FILE.urdf`). Base body in
            an MJCF, by default the world.
        tip: Tip link in a URDF; site or body of the tool in an MJCF.
        out: Arm model file to write, for use with --arm.
        fit: Groups of deviations to fit: lengths, mount, zeros, scales.
        json: Print one JSON document instead of tables.
    """
    screen = Screen(json)
    model = find_arm(arm, base, tip)
    data = load_probe_points(points, model.joint_names)
    with screen.step(f"fitting {len(data.tip)} probe points"):
        found = calibrate_arm(model, data.q, data.tip, fit=fit)
    save_model(found.model, out)
    rows = [
        (name, *_shown(name, float(value), float(error)))
        for name, value, error in zip(found.names, found.errors.flat(), found.deviation.flat(), strict=True)
        if value != 0.0 or error != 0.0
    ]
    screen.table("deviations from the nominal arm", ("", "deviation", "standard error"), rows)
    for text in found.undetermined:
        screen.say(f"not determined by these probe points: {text}; held at the nominal value")
    if found.outliers:
        screen.say(f"rejected as outliers: probe points {', '.join(str(i + 1) for i in found.outliers)}")
    screen.say(f"noise {1e3 * found.noise:.2f} mm per coordinate; angle = (1 + scale) reading")
    screen.say(f"saved {out}; use it with --arm {out}")
    screen.result(_facts(found, out))
    return 0


def train_policy(
    arm: str = "iiwa14",
    base: str | None = None,
    tip: str | None = None,
    out: Path = Path("elbow.policy"),
    energy: Literal["joint-motion", "holding", "servo"] = "joint-motion",
    steps: int | None = None,
    plans: int | None = None,
    seed: int = 0,
    folder: Path | None = None,
    json: bool = False,
) -> int:
    """Train an elbow policy for an arm: by the energy of its motions, then by imitation of plans.

    Args:
        arm: Preset (`jaxik info` lists them), model file (.json), URDF (.urdf) or MJCF (.xml).
        base: Base link in a URDF; not needed, as the tip, if it has one arm (see `jaxik info FILE.urdf`). Base body in
            an MJCF, by default the world.
        tip: Tip link in a URDF; site or body of the tool in an MJCF.
        out: Policy file to write.
        energy: Energy to minimize: joint-motion, holding or servo.
        steps: Steps of the training by energy; more steps than the default give a better policy.
        plans: Number of plans to imitate afterwards; 0 for none.
        seed: Seed; equal seeds give equal policies.
        folder: Folder for checkpoints and metrics, from which an interrupted run continues.
        json: Print one JSON document instead of text.
    """
    from training.policy.evaluation import evaluate, held_out_paths
    from training.policy.policy import save_policy
    from training.policy.training import PolicyConfig, train

    screen = Screen(json)
    model, wanted = find_arm(arm, base, tip), ENERGIES[energy]()
    config = PolicyConfig(seed=seed, folder=folder).sized(steps, plans)
    with screen.step(f"training a policy for {model.name}") as bar:
        ranges = {"by energy": (0.0, 0.6), "plans": (0.6, 0.2), "from plans": (0.8, 0.2)}
        trained = train(config, arm=model, energy=wanted, progress=lambda s, x: bar(ranges[s][0] + ranges[s][1] * x))
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
    """Train a natural elbow on recorded arms of a person.

    Args:
        recording: Recorded frames (.csv) with the columns elbow_x to hand_qw, see docs/learning.md.
        out: File to write, for `training.load_natural_elbow` and `training.human_elbow`.
        held_out: Fraction of the recording, at its end, that is held out for evaluation.
        seed: Seed; equal seeds give equal policies.
        folder: Folder for checkpoints and metrics, from which an interrupted run continues.
        json: Print one JSON document instead of the table.
    """
    from training.human.data import load_human
    from training.human.natural_elbow import save_natural_elbow
    from training.human.training import HumanConfig
    from training.human.training import train_human as train_on

    screen = Screen(json)
    frames = load_human(recording)
    with screen.step(f"training on {frames.count} frames") as bar:
        trained = train_on(frames, HumanConfig(seed=seed, held_out=held_out).stored(folder), progress=bar)
    save_natural_elbow(trained.policy, out)
    rows = [(name, f"{s.median:.1f}", f"{s.p90:.1f}") for name, s in trained.scores.items()]
    title = f"elbow error on the last {held_out:.0%} of the recording, % of its unit of length"
    screen.table(title, ("", "median", "90th percentile"), rows)
    screen.say(f"saved {out}")
    screen.result({"file": str(out), "scores": {name: [s.median, s.p90] for name, s in trained.scores.items()}})
    return 0


def _shown(name: str, value: float, error: float) -> tuple[str, str]:
    """Deviation and standard error as text, in mm, degrees or percent."""
    factor, unit = 100.0, "%"
    if name.startswith("shoulder"):
        factor, unit = 1e3, "mm"
    elif name.startswith(("rotation", "zero")):
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
