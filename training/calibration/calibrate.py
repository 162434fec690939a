"""Kinematic calibration: a model's deviations from joint readings and measured tips, with standard errors.

1. Deviations (lengths, mount, zeros, scales) are measured in units of what an assembled arm has: 5 %, 3 degrees.
2. Gauss-Newton with Tukey weights, from the nominal arm: the spread of the residuals says what an outlier is.
3. Touches beyond five standard deviations are left out, and the rest fitted by plain least squares, whose standard
   errors are exact.
4. A direction that the noise leaves more uncertain than those units is held at the nominal value, and named.
"""

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from jaxik.arm import Arm, ArmModel
from jaxik.errors import JaxikError
from jaxik.kinematics import forward_kinematics
from training.calibration.kinematic_errors import KinematicErrors, deviating_arm, names_of

GROUPS = ("lengths", "mount", "zeros", "scales")
TYPICAL = 0.05  # 5 % of a length or scale, 3 degrees of a zero: what a ruler and a servo horn leave
_TUKEY = 4.685  # 95 % efficiency at Gaussian noise (Holland and Welsch, 1977)
_OUTLIER = 5.0  # standard deviations; leaving out good touches would make the standard errors too small
_ROUNDS, _FINAL = 40, 10
_MEDIAN = 1.538  # of the length of a three-dimensional unit Gaussian
_NAMED = 0.1  # share of a parameter in an undetermined direction from which on it is itself called undetermined


class CalibrationError(JaxikError, ValueError):
    """The touches cannot calibrate the arm; says why and what to do."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class CalibrationFit:
    """What the numbers say, as arrays; see :func:`fit_kinematics`.

    Attributes:
        errors: The arm's deviations.
        deviation: Their standard errors, in the same shapes; as large as the unit where held at the nominal value.
        residual: Measured less modelled tip, ``(N, 3)`` [m].
        used: Touches that are no outliers, ``(N,)``.
        noise: Standard deviation of a measured coordinate, ``()`` [m].
        directions: Orthonormal directions of :meth:`KinematicErrors.flat` in units of what is typical,
            ``(parameter, parameter)``, one a row.
        determined: Which of them the touches determine, ``(parameter,)``.
        step: Length of the last step, in those units: beyond 1e-3 it did not converge, ``()``.
    """

    errors: KinematicErrors
    deviation: KinematicErrors
    residual: Float[Array, "touch 3"]
    used: Bool[Array, "touch"]
    noise: Float[Array, ""]
    directions: Float[Array, "parameter parameter"]
    determined: Bool[Array, "parameter"]
    step: Float[Array, ""]


@dataclass(frozen=True)
class Calibration:
    """A calibrated arm and how well it is known; a value of the host.

    Attributes:
        model: The arm with its deviations built in (see :func:`training.deviating_arm`): at angles
            ``(1 + scale) reading`` it is where the real one is.
        errors: The deviations.
        deviation: Their standard errors; infinite for what the touches do not determine.
        undetermined: In words, what the touches cannot tell apart or do not show at all.
        noise: Standard deviation of a measured coordinate [m].
        outliers: Touches left out.
        residual: Measured less modelled tip, ``(N, 3)`` [m].
        names: What each number of ``errors.flat()`` is called.
    """

    model: ArmModel
    errors: KinematicErrors
    deviation: KinematicErrors
    undetermined: tuple[str, ...]
    noise: float
    outliers: tuple[int, ...]
    residual: np.ndarray
    names: tuple[str, ...]

    def angles(self, reading: Float[ArrayLike, "*batch joint"]) -> Float[Array, "*batch joint"]:
        """Angles of the calibrated model for joint readings [rad]."""
        return (1.0 + self.errors.scale) * jnp.asarray(reading)


def calibrate(
    arm: Arm | ArmModel,
    q: Float[ArrayLike, "touch joint"],
    tip_points: Float[ArrayLike, "touch 3"],
    *,
    fit: tuple[str, ...] = GROUPS,
) -> Calibration:
    """Fits a model to where the tool's tip was measured to be.

    Args:
        arm: The nominal arm.
        q: Joint readings, ``(N, joint)`` [rad]; spread them over the joints' ranges.
        tip_points: Measured tool points in the arm's base frame, ``(N, 3)`` [m]; some may be plain wrong.
        fit: Which deviations to look for, of ``"lengths"``, ``"mount"``, ``"zeros"`` and ``"scales"``.

    Returns:
        The calibrated model, its deviations and their standard errors.

    Raises:
        CalibrationError: Too few touches, or numbers that no such arm explains.
        ValueError: Wrong shapes, values that are not finite, or an unknown group.

    **Differentiability**: none; :func:`fit_kinematics` is the array function behind it.
    """
    bare, model = (arm.arm, arm) if isinstance(arm, ArmModel) else (arm, None)
    reading, tip = np.asarray(q, bare.axes.dtype), np.asarray(tip_points, bare.axes.dtype)
    if reading.shape != (len(tip), bare.n_joints) or tip.shape != (len(reading), 3):
        raise ValueError(f"expected q (N, {bare.n_joints}) and tip_points (N, 3); got {reading.shape} and {tip.shape}")
    for name, values in (("q", reading), ("tip_points", tip)):
        bad = ~np.isfinite(values).all(axis=-1)
        if bad.any():
            raise ValueError(f"{name} of touch {int(np.argmax(bad))} is not finite")
    for group in fit:
        if group not in GROUPS:
            raise ValueError(f"fit names {group!r}; there are {', '.join(GROUPS)}")
    mask = fitted_parameters(bare, fit)
    if 3 * len(tip) <= mask.sum():
        raise CalibrationError(
            f"{len(tip)} touches give {3 * len(tip)} numbers for {int(mask.sum())} unknowns; touch at least "
            f"{int(mask.sum()) // 3 + 1} points, better three times as many, or name fewer unknowns with fit"
        )
    found = jax.device_get(_fit(bare, jnp.asarray(reading), jnp.asarray(tip), jnp.asarray(mask)))
    if not found.step < 1e-3:
        raise CalibrationError(
            f"the fit does not settle (last step {found.step:.2g} of a typical error): check units (radians, metres), "
            "the order of the joints and their signs"
        )
    joints = tuple(f"joint_{i + 1}" for i in range(bare.n_joints)) if model is None else model.joint_names
    names = names_of(joints)
    unknown = found.directions[~found.determined & (np.abs(found.directions) @ mask > 1e-6)]
    vague = np.linalg.norm(unknown, axis=0) > _NAMED
    deviation = np.where(vague, np.inf, np.asarray(found.deviation.flat()))
    errors = jax.tree.map(jnp.asarray, found.errors)
    outliers = tuple(int(i) for i in np.flatnonzero(~found.used))
    return Calibration(
        model=_calibrated_model(model, bare, errors, joints, len(tip), found),
        errors=errors,
        deviation=errors.like(jnp.asarray(deviation)),
        undetermined=_in_words(unknown, names),
        noise=float(found.noise),
        outliers=outliers,
        residual=np.asarray(found.residual),
        names=names,
    )


def fitted_parameters(arm: Arm, fit: tuple[str, ...]) -> np.ndarray:
    """1 for the numbers of :meth:`KinematicErrors.flat` in some groups, else 0: ``(parameter,)``."""
    counts = {"lengths": 3, "mount": 6, "zeros": arm.n_joints, "scales": arm.n_joints}
    return np.concatenate([np.full(n, float(group in fit), arm.axes.dtype) for group, n in counts.items()])


def fit_kinematics(
    arm: Arm,
    q: Float[Array, "touch joint"],
    tip_points: Float[Array, "touch 3"],
    mask: Float[Array, "parameter"],
) -> CalibrationFit:
    """:func:`calibrate` as a function of arrays, for ``jit`` and ``vmap``; the dtype is the arm's.

    Args:
        arm: The nominal arm.
        q: Joint readings, ``(N, joint)`` [rad].
        tip_points: Measured tool points, ``(N, 3)`` [m].
        mask: 1 for parameters to fit, 0 for those to leave, ``(parameter,)``.

    Returns:
        The fit; look at ``step`` before believing it.

    **Differentiability**: through fixed numbers of iterations; not meant for it.
    """
    nominal = KinematicErrors.none(arm)
    metres = jnp.ones_like(mask).at[3:6].set(arm.length)
    unit = TYPICAL * metres * mask

    def residual(x: Array) -> Array:
        errors = nominal.like(unit * x)
        return tip_points - forward_kinematics(deviating_arm(arm, errors), (1.0 + errors.scale) * q).position

    def linear(x: Array, weight: Array) -> tuple[Array, Array, Array, Array, Array]:
        """Residual, singular values and right vectors of the weighted problem, noise, and the step."""
        r, jacobian = residual(x), -jax.jacfwd(residual)(x)
        root = jnp.sqrt(weight)[:, None]
        u, s, vt = jnp.linalg.svd((root[..., None] * jacobian).reshape(-1, x.size), full_matrices=False)
        length = jnp.linalg.norm(r, axis=-1)
        freedom = jnp.maximum(3.0 * jnp.sum(weight) - jnp.sum(mask), 1.0)
        noise = jnp.sqrt(jnp.sum(weight * length**2) / freedom)
        keep = _determined(s, noise)
        step = vt.T @ (jnp.where(keep, 1.0 / jnp.where(keep, s, 1.0), 0.0) * (u.T @ (root * r).reshape(-1)))
        return r, s, vt, noise, step

    def spread(r: Array) -> Array:
        floor = 64 * float(jnp.finfo(r.dtype).eps) * arm.length
        # Fitting makes residuals smaller than the noise.
        shrunk = jnp.sqrt(jnp.maximum(1.0 - jnp.sum(mask) / r.size, 0.1))
        return jnp.maximum(jnp.median(jnp.linalg.norm(r, axis=-1)) / (_MEDIAN * shrunk), floor)

    def robust(x: Array, _: None) -> tuple[Array, None]:
        r = residual(x)
        ratio = jnp.linalg.norm(r, axis=-1) / (_TUKEY * spread(r))
        step = linear(x, jnp.where(ratio < 1.0, (1.0 - ratio**2) ** 2, 0.0))[-1]
        # Far from the solution a full step may leave the region where the arm is nearly linear.
        return x + step * jnp.minimum(1.0, 3.0 / jnp.maximum(jnp.linalg.norm(step), 1e-9)), None

    x, _ = jax.lax.scan(robust, jnp.zeros_like(mask), None, _ROUNDS)
    r = residual(x)
    used = jnp.linalg.norm(r, axis=-1) <= _OUTLIER * spread(r)
    weight = used.astype(x.dtype)

    def plain(x: Array, _: None) -> tuple[Array, Array]:
        step = linear(x, weight)[-1]
        return x + step, jnp.linalg.norm(step)

    x, steps = jax.lax.scan(plain, x, None, _FINAL)
    r, s, vt, noise, _ = linear(x, weight)
    keep = _determined(s, noise)
    # What is held at the nominal value is as uncertain as that.
    variance = jnp.sum(jnp.where(keep, noise / jnp.where(keep, s, 1.0), 1.0)[:, None] ** 2 * vt**2, axis=0)
    return CalibrationFit(
        errors=nominal.like(unit * x),
        deviation=nominal.like(unit * jnp.sqrt(variance)),
        residual=r,
        used=used,
        noise=noise,
        directions=vt,
        determined=keep,
        step=steps[-1],
    )


_fit = jax.jit(fit_kinematics)


def _determined(s: Array, noise: Array) -> Array:
    """Directions known better than what is typical, and above rounding."""
    return (s > noise) & (s > float(jnp.finfo(s.dtype).eps) ** 0.5 * s[0])


def _in_words(unknown: np.ndarray, names: tuple[str, ...]) -> tuple[str, ...]:
    """One phrase per undetermined direction, each reduced to few parameters (reduced row echelon form)."""
    rows = unknown.copy()
    for i in range(len(rows)):
        pivot = int(np.argmax(np.abs(rows[i])))
        rows[i] /= rows[i, pivot]
        for j in range(len(rows)):
            if j != i:
                rows[j] -= rows[j, pivot] * rows[i]
    phrases = []
    for row in rows:
        large = np.flatnonzero(np.abs(row) > _NAMED * np.abs(row).max())
        told = [names[i] for i in large[np.argsort(-np.abs(row[large]))]]
        phrases.append(told[0] if len(told) == 1 else f"{' against '.join(told)}")
    return tuple(phrases)


def _calibrated_model(
    model: ArmModel | None, arm: Arm, errors: KinematicErrors, joints: tuple[str, ...], count: int, fit: CalibrationFit
) -> ArmModel:
    """The model with the calibrated arm, saying so in its notes."""
    scales = ", ".join(f"{name} {1 + float(s):.4f}" for name, s in zip(joints, errors.scale, strict=True))
    notes = (
        f"Calibrated on {int(fit.used.sum())} of {count} touches; {1e3 * float(fit.noise):.2f} mm noise.",
        f"Angles are joint readings times: {scales}.",
    )
    calibrated = deviating_arm(arm, errors)
    if model is None:
        return ArmModel(calibrated, joints, "calibrated", "training.calibrate", notes)
    return replace(model, arm=calibrated, name=f"{model.name}_calibrated", notes=(*model.notes, *notes))
