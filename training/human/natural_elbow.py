"""Predicted elbow positions of people, by the policies' network.

The network predicts the elbow direction from a single hand pose. The prediction is therefore a function of the posture,
which a plan can use as an energy.
"""

import os

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike
from jaxtyping import Float

from jaxik.arm import Arm, ArmModel, StereographicReference, as_arm, model_content, model_from_content
from jaxik.ik import solve_ik
from jaxik.kinematics import joint_positions
from jaxik.numerics import tolerances, vec3
from jaxik.redundancy import swivel_toward
from jaxik.targets import Pose, TargetLike, as_floats, as_target, compose, rotate
from training import network_files
from training.waypoint_net import WaypointNet

_KIND = "natural-elbow"
FEATURES, _LAYERS = 22, (0, 0)


class NaturalElbow(eqx.Module):
    """Prediction of a person's elbow from the hand.

    Attributes:
        nets: Ensemble of networks along a leading axis, trained on different samples.
        arm: The person's right arm, with the shoulder at the origin, x forward, y left and z up.
    """

    nets: WaypointNet
    arm: Arm

    def direction(
        self, position: Float[Array, "*batch 3"], rotation: Float[Array, "*batch 3 3"]
    ) -> Float[Array, "*batch 3"]:
        """Return the direction of the elbow from the line between shoulder and wrist.

        Args:
            position: Wrist relative to the shoulder, in the person's unit of length, ``(*batch, 3)``.
            rotation: Rotation of the hand with z along the hand and x toward the thumb, ``(*batch, 3, 3)``.

        Returns:
            Unit vectors perpendicular to that line, ``(*batch, 3)``.

        **Differentiability**: smooth, except where the predictions of the ensemble cancel.
        """
        x = hand_features(self.arm, position, rotation).astype(jnp.float32)
        line = jnp.moveaxis(unit(position), -1, 0).astype(jnp.float32)
        pulls = eqx.filter_vmap(lambda net: net(x.reshape(len(x), 1, -1)))(self.nets)
        votes = jax.vmap(across, in_axes=(0, None))(pulls.reshape(-1, *line.shape), line)
        total = across(jnp.mean(votes, axis=0), line)
        return jnp.moveaxis(total, 0, -1).astype(position.dtype)

    def elbow_direction(
        self, arm: Arm | ArmModel, target: TargetLike, *, side: str = "right", person: ArrayLike | None = None
    ) -> Float[Array, "*batch 3"]:
        """Return the direction in which any arm's elbow is natural, from the line between its shoulder and wrist.

        The hand is scaled to the person's arm, so that only directions matter, not sizes.

        Args:
            arm: The arm to move, for :func:`jaxik.solve_ik`.
            target: Poses of its tool, ``(*batch,)``; the tool's frame is the hand's, with z along the hand and x toward
                the thumb.
            side: ``"right"``, or ``"left"`` for the mirror image of the recorded arm.
            person: Rotation from the arm's base frame to the person's (x forward, y left, z up), ``(3, 3)``; None if
                the frames agree, as for the Meccanoid.

        Returns:
            Unit vectors in the arm's base frame, ``(*batch, 3)``.

        Raises:
            ValueError: ``side`` is neither of the two, or the targets are no poses.

        **Differentiability**: as :meth:`direction`.
        """
        arm, target = as_arm(arm), as_target(target)
        if not isinstance(target, Pose):
            raise ValueError(f"expected poses, since the elbow depends on the hand's roll, got {type(target).__name__}")
        position, rotation = as_floats(target.position, target.rotation)
        arm = arm.astype(position.dtype)
        hand = arm.tool_rotation.T @ (arm.tool_position - arm.wrist)
        wrist = position - rotate(rotation, hand) - arm.shoulder
        return natural_direction(self, arm, wrist, rotation, person_frame(side, person))

    def swivel(
        self, arm: Arm | ArmModel, target: TargetLike, *, side: str = "right", person: ArrayLike | None = None
    ) -> Float[Array, "*batch"]:
        """Return the swivel at which any arm's elbow is natural; :func:`jaxik.solve_ik` takes it.

        Args:
            arm: The arm to move; ``.arm`` is the person's own.
            target: Poses of its tool, ``(*batch,)``, as for :meth:`elbow_direction`.
            side: ``"right"`` or ``"left"``.
            person: Rotation from the arm's base frame to the person's, ``(3, 3)``; None if the frames agree.

        Returns:
            Swivels of the arm, ``(*batch,)`` [rad]; joint limits are left aside.

        Raises:
            ValueError: ``side`` is neither of the two, or the targets are no poses.

        **Differentiability**: as :meth:`direction` and :func:`jaxik.swivel_toward`.
        """
        target = as_target(target)
        toward = self.elbow_direction(arm, target, side=side, person=person)
        if as_arm(arm).n_joints == 6:
            target = target.pointing()  # pyright: ignore[reportAttributeAccessIssue]
        return swivel_toward(arm, target, direction=toward)


def person_frame(side: str, person: ArrayLike | None) -> Float[Array, "3 3"]:
    """Return the rotation from an arm's base frame to the person's, with determinant -1 for a left arm.

    Raises:
        ValueError: ``side`` is neither ``"left"`` nor ``"right"``.
    """
    if side not in ("left", "right"):
        raise ValueError(f'side must be "left" or "right", got {side!r}')
    frame = jnp.eye(3) if person is None else jnp.asarray(person, float)
    return frame * jnp.array([1.0, -1.0 if side == "left" else 1.0, 1.0])[:, None]


def natural_direction(policy: NaturalElbow, arm: Arm, wrist: Array, rotation: Array, person: Array) -> Array:
    """Return the natural direction of an arm's elbow in its base frame, ``(*batch, 3)``.

    Args:
        policy: Predicts a person's elbow.
        arm: The arm.
        wrist: Vectors from shoulder to wrist, ``(*batch, 3)`` [m].
        rotation: Rotations of the hand, ``(*batch, 3, 3)``.
        person: See :func:`person_frame`.
    """
    person = person.astype(wrist.dtype)
    # A mirrored hand frame is made right-handed again by flipping its second axis.
    flip = jnp.where(jnp.linalg.det(person) < 0.0, -1.0, 1.0).astype(wrist.dtype)
    hand = rotation * jnp.stack([jnp.ones_like(flip), flip, jnp.ones_like(flip)])
    scale = (_reach(policy.arm) / _reach(arm)).astype(wrist.dtype)
    toward = policy.direction(rotate(person, wrist) * scale, compose(person, hand))
    return rotate(person.T, toward)


def _reach(arm: Arm) -> Array:
    return jnp.linalg.norm(arm.elbow - arm.shoulder) + jnp.linalg.norm(arm.wrist - arm.elbow)


def save_natural_elbow(policy: NaturalElbow, file: str | os.PathLike[str]) -> None:
    """Write a natural elbow to a file.

    Args:
        policy: The natural elbow.
        file: File name.

    Raises:
        OSError: The file cannot be written.
    """
    model = ArmModel(policy.arm, tuple(f"human_{i}" for i in range(1, 8)), "human_arm", "")
    members, width = policy.nets.first.shape[:2]
    facts = {"members": int(members), "width": int(width), "arm": model_content(model)}
    network_files.write(file, _KIND, facts, policy.nets)


def load_natural_elbow(file: str | os.PathLike[str]) -> NaturalElbow:
    """Read a natural elbow written by :func:`save_natural_elbow`.

    Args:
        file: File name.

    Returns:
        The natural elbow, bit for bit.

    Raises:
        FileFormatError: The file has another format.
        OSError: The file cannot be read.
    """
    header = network_files.read_header(file, _KIND)
    nets = make_networks(jax.random.key(0), header["members"], header["width"])
    return NaturalElbow(network_files.read(file, nets), model_from_content(header["arm"]).arm)


def hand_features(arm: Arm, position: Array, rotation: Array) -> Array:
    """Return the features of hand poses, ``(22, *batch)``.

    They are the position of the hand in arm lengths, its distance, its rotation, and its rotation relative to the
    elbow's circle.
    """
    scaled = position / _reach(arm).astype(position.dtype)
    line = unit(position)
    circle = jnp.stack([line, *_reference(arm, line)], axis=-2)
    turned = [m.reshape(*m.shape[:-2], 9) for m in (rotation, circle @ rotation)]
    far = jnp.linalg.norm(scaled, axis=-1, keepdims=True)
    return jnp.moveaxis(jnp.concatenate([scaled, far, *turned], axis=-1), -1, 0)


def elbow_circle(arm: Arm, target: Pose) -> tuple[Array, Array, Array]:
    """Return the center of the elbow's circle and the vectors to its points at swivel 0 and π/2, ``(*batch, 3)`` each.

    They are computed from three solutions of the closed form, since three points determine the circle.

    **Differentiability**: as :func:`jaxik.solve_ik`.
    """
    dtype = target.position.dtype

    def elbow(swivel: float) -> Array:
        at = jnp.full(target.position.shape[:-1], swivel, dtype)
        return joint_positions(arm, solve_ik(arm, target, at).q[..., 0, :])[..., 1, :]

    ahead, side, behind = (elbow(swivel) for swivel in (0.0, np.pi / 2, np.pi))
    center = (ahead + behind) / 2
    return center, (ahead - behind) / 2, side - center


def make_networks(key: Array, members: int, width: int) -> WaypointNet:
    """Return untrained networks along a leading axis."""
    keys = jax.random.split(key, members)

    def one(key: Array) -> WaypointNet:
        net = WaypointNet(FEATURES, 3, width, _LAYERS, key)
        # A zero output has no direction and hence no gradient, so start with random outputs.
        return eqx.tree_at(lambda n: n.last, net, jax.random.normal(key, net.last.shape, jnp.float32) / width**0.5)

    return eqx.filter_vmap(one)(keys)


def across(pull: Array, line: Array) -> Array:
    """Return the direction of the component of ``pull`` perpendicular to unit vectors ``line``, ``(3, ...)``."""
    part = pull - jnp.sum(pull * line, axis=0) * line
    return part / jnp.sqrt(jnp.sum(part**2, axis=0) + 1e-6)


def _reference(arm: Arm, line: Array) -> tuple[Array, Array]:
    """Directions of swivel 0 and π/2, perpendicular to unit vectors ``(*batch, 3)``."""
    n = jnp.moveaxis(line, -1, 0)
    pole, first = (v.astype(n.dtype).reshape(3, *(1,) * (n.ndim - 1)) for v in arm.reference.vectors())
    zero, _ = StereographicReference(pole, first).zero_direction(n, tolerances(n.dtype))
    return jnp.moveaxis(zero, 0, -1), jnp.moveaxis(vec3.cross(n, zero), 0, -1)


def unit(v: Array) -> Array:
    """Return vectors ``(*batch, 3)`` scaled to unit length; smooth at zero."""
    return v / jnp.sqrt(jnp.sum(v**2, axis=-1, keepdims=True) + 1e-12)
