"""Kinematic calibration: deviations from the nominal arm and their standard errors, from measured tip positions.

1. Deviations (lengths, mount, zeros, scales) are scaled by typical values of an assembled arm: 5 %, 3 degrees.
2. Gauss-Newton iterations with Tukey weights start at the nominal arm; the spread of the residuals identifies outliers.
3. Probe points beyond five standard deviations are rejected, and the rest is fitted by ordinary least squares, which
   gives the standard errors.
4. Directions whose uncertainty exceeds the typical values are held at the nominal value and reported.
"""

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from jaxik.arm import Arm, ArmModel, as_arm
from jaxik.errors import JaxikError
from jaxik.kinematics import forward_kinematics
from training.calibration.kinematic_errors import KinematicErrors, deviating_arm, names_of

GROUPS = ("lengths", "mount", "zeros", "scales")
TYPICAL = 0.05  # 5 % of a length or scale, 3 degrees of a zero, as left by a ruler and a servo horn
_TUKEY = 4.685  # 95 % efficiency at Gaussian noise (Holland and Welsch, 1977)
_OUTLIER = 5.0  # standard deviations; rejecting good points would make the standard errors too small
_ROUNDS, _FINAL = 40, 10
_MEDIAN = 1.538  # of the norm of a three-dimensional standard normal vector
_NAMED = 0.1  # parameters above this component of an undetermined direction are reported as undetermined


class CalibrationError(JaxikError, ValueError):
    """The probe points cannot calibrate the arm; the message gives the reason and a remedy."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class CalibrationFit:
    """Result of :func:`fit_kinematics` as arrays.

    Attributes:
        errors: Deviations from the nominal arm.
        deviation: Standard errors of the deviations; the typical value for directions held at the nominal value.
        residual: Measured minus modeled tip positions, ``(N, 3)`` [m].
        used: Probe points that are not outliers, ``(N,)``.
        noise: Standard deviation of a measured coordinate, ``()`` [m].
        directions: Orthonormal directions of :meth:`KinematicErrors.flat`, scaled by the typical values, one per row,
            ``(parameter, parameter)``.
        determined: Directions that the probe points determine, ``(parameter,)``.
        step: Norm of the last step, scaled by the typical values, ``()``; the fit has not converged if above 1e-3.
    """

    errors: KinematicErrors
    deviation: KinematicErrors
    residual: Float[Array, "point 3"]
    used: Bool[Array, "point"]
    noise: Float[Array, ""]
    directions: Float[Array, "parameter parameter"]
    determined: Bool[Array, "parameter"]
    step: Float[Array, ""]


@dataclass(frozen=True)
class Calibration:
    """A calibrated arm with its uncertainty, as host values.

    Attributes:
        model: The arm with the deviations built in (see :func:`training.deviating_arm`); its joint angles are
            ``(1 + scale) reading``.
        errors: Deviations from the nominal arm.
        deviation: Standard errors of the deviations; infinite for parameters that the probe points do not determine.
        undetermined: Names of the parameters and combinations that the probe points do not determine.
        noise: Standard deviation of a measured coordinate [m].
        outliers: Indices of the rejected probe points.
        residual: Measured minus modeled tip positions, ``(N, 3)`` [m].
        names: Names of the numbers in ``errors.flat()``.
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
        """Convert joint readings to joint angles of the calibrated model.

        Args:
            reading: Joint readings, ``(*batch, joint)`` [rad].

        Returns:
            Joint angles, ``(*batch, joint)`` [rad].
        """
        return (1.0 + self.errors.scale) * jnp.asarray(reading)


def calibrate(
    arm: Arm | ArmModel,
    q: Float[ArrayLike, "point joint"],
    tip_points: Float[ArrayLike, "point 3"],
    *,
    fit: tuple[str, ...] = GROUPS,
) -> Calibration:
    """Fit the geometry of an arm to measured positions of the tool's tip.

    Args:
        arm: The nominal arm.
        q: Joint readings, ``(N, joint)`` [rad], spread over the joints' ranges.
        tip_points: Measured tool points in the arm's base frame, ``(N, 3)`` [m]; may contain outliers.
        fit: Groups of deviations to fit: ``"lengths"``, ``"mount"``, ``"zeros"``, ``"scales"``.

    Returns:
        The calibrated model, its deviations and their standard errors.

    Raises:
        CalibrationError: There are too few probe points, or the fit does not converge.
        ValueError: A shape is wrong, a value is not finite, or a group is unknown.

    **Differentiability**: none; :func:`fit_kinematics` is the underlying array function.
    """
    bare, model = as_arm(arm), arm if isinstance(arm, ArmModel) else None
    reading, tip = np.asarray(q, bare.axes.dtype), np.asarray(tip_points, bare.axes.dtype)
    if reading.shape != (len(tip), bare.n_joints) or tip.shape != (len(reading), 3):
        raise ValueError(f"expected q (N, {bare.n_joints}) and tip_points (N, 3), got {reading.shape} and {tip.shape}")
    for name, values in (("q", reading), ("tip_points", tip)):
        bad = ~np.isfinite(values).all(axis=-1)
        if bad.any():
            raise ValueError(
                f"expected finite numbers, got {values[bad][0].tolist()} in {name} of probe point {int(np.argmax(bad))}"
            )
    for group in fit:
        if group not in GROUPS:
            raise ValueError(f"expected groups among {', '.join(GROUPS)}, got {group!r}")
    mask = fitted_parameters(bare, fit)
    if 3 * len(tip) <= mask.sum():
        raise CalibrationError(
            f"{len(tip)} probe points give {3 * len(tip)} numbers for {int(mask.sum())} unknowns; measure at least "
            f"{int(mask.sum()) // 3 + 1} points, better three times as many, or fit fewer groups"
        )
    found = jax.device_get(_fit(bare, jnp.asarray(reading), jnp.asarray(tip), jnp.asarray(mask)))
    if not found.step < 1e-3:
        raise CalibrationError(
            f"the fit does not converge (last step {found.step:.2g} typical deviations); check the units (radians, "
            "meters), the order of the joints and their signs"
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
        undetermined=_phrases(unknown, names),
        noise=float(found.noise),
        outliers=outliers,
        residual=np.asarray(found.residual),
        names=names,
    )


def fitted_parameters(arm: Arm, fit: tuple[str, ...]) -> np.ndarray:
    """Return 1 for the numbers of :meth:`KinematicErrors.flat` in the given groups, else 0, ``(parameter,)``."""
    counts = {"lengths": 3, "mount": 6, "zeros": arm.n_joints, "scales": arm.n_joints}
    return np.concatenate([np.full(n, float(group in fit), arm.axes.dtype) for group, n in counts.items()])


def fit_kinematics(
    arm: Arm,
    q: Float[Array, "point joint"],
    tip_points: Float[Array, "point 3"],
    mask: Float[Array, "parameter"],
) -> CalibrationFit:
    """Fit the geometry of an arm as :func:`calibrate` does, as an array function for ``jit`` and ``vmap``.

    The dtype is the arm's.

    Args:
        arm: The nominal arm.
        q: Joint readings, ``(N, joint)`` [rad].
        tip_points: Measured tool points, ``(N, 3)`` [m].
        mask: 1 for parameters to fit, 0 for parameters to hold, ``(parameter,)``.

    Returns:
        The fit; check ``step`` for convergence.

    **Differentiability**: through a fixed number of iterations; not intended.
    """
    nominal = KinematicErrors.none(arm)
    scale = jnp.ones_like(mask).at[3:6].set(arm.length)
    unit = TYPICAL * scale * mask

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
        # Residuals of a fit are smaller than the noise.
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
    # Directions held at the nominal value keep their typical deviation.
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
    """Directions more certain than the typical values and above rounding errors."""
    return (s > noise) & (s > float(jnp.finfo(s.dtype).eps) ** 0.5 * s[0])


def _phrases(unknown: np.ndarray, names: tuple[str, ...]) -> tuple[str, ...]:
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
        named = [names[i] for i in large[np.argsort(-np.abs(row[large]))]]
        phrases.append(" against ".join(named))
    return tuple(phrases)


def _calibrated_model(
    model: ArmModel | None, arm: Arm, errors: KinematicErrors, joints: tuple[str, ...], count: int, fit: CalibrationFit
) -> ArmModel:
    """Model of the calibrated arm, with the calibration in its notes."""
    scales = ", ".join(f"{name} {1 + float(s):.4f}" for name, s in zip(joints, errors.scale, strict=True))
    notes = (
        f"Calibrated on {int(fit.used.sum())} of {count} probe points; noise {1e3 * float(fit.noise):.2f} mm.",
        f"Angles are joint readings times: {scales}.",
    )
    calibrated = deviating_arm(arm, errors)
    if model is None:
        return ArmModel(calibrated, joints, "calibrated", "training.calibrate", notes)
    return replace(model, arm=calibrated, name=f"{model.name}_calibrated", notes=(*model.notes, *notes))
