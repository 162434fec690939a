"""Where people put their elbow, as the policies' network says it.

Nothing prices a human posture, so here the network says the swivel itself. It sees one hand pose at a time: that makes
it a function of the posture, which a plan can have as an energy.
"""

import os

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from jaxik.arm import Arm, ArmModel, StereographicReference, model_content, model_from_content
from jaxik.ik import solve_ik
from jaxik.kinematics import joint_positions
from jaxik.numerics import tolerances, vec3
from jaxik.targets import Pose
from training import network_files as policy_files
from training.policy.network import WaypointNet

_KIND = "natural-elbow"
FEATURES, _LAYERS = 22, (0, 0)


class NaturalElbow(eqx.Module):
    """A person's elbow as a function of the hand.

    Attributes:
        nets: Some networks with a leading axis, trained on different samples; they vote.
        arm: The person's arm, shoulder at the origin, x forward, y left, z up; a right one.
    """

    nets: WaypointNet
    arm: Arm

    def direction(
        self, position: Float[Array, "*batch 3"], rotation: Float[Array, "*batch 3 3"]
    ) -> Float[Array, "*batch 3"]:
        """Where the elbow is, seen from the line between shoulder and hand, for hand poses relative to the shoulder.

        Args:
            position: Where forearm and hand meet, in the person's lengths, ``(*batch, 3)``.
            rotation: z where the hand points, x towards the thumb, ``(*batch, 3, 3)``.

        Returns:
            Unit vectors across that line, ``(*batch, 3)``.

        **Differentiability**: smooth, but where the networks' votes cancel.
        """
        x = hand_features(self.arm, position, rotation).astype(jnp.float32)
        line = jnp.moveaxis(unit(position), -1, 0).astype(jnp.float32)
        pulls = eqx.filter_vmap(lambda net: net(x.reshape(len(x), 1, -1)))(self.nets)
        votes = jax.vmap(across, in_axes=(0, None))(pulls.reshape(-1, *line.shape), line)
        total = across(jnp.mean(votes, axis=0), line)
        return jnp.moveaxis(total, 0, -1).astype(position.dtype)

    def swivel(
        self, position: Float[Array, "*batch 3"], rotation: Float[Array, "*batch 3 3"]
    ) -> Float[Array, "*batch"]:
        """The same as swivel of the person's arm, ``(*batch,)`` [rad]."""
        toward = self.direction(position, rotation)
        zero, quarter = _reference(self.arm, unit(position))
        return jnp.arctan2(jnp.sum(toward * quarter, axis=-1), jnp.sum(toward * zero, axis=-1))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes a file that :func:`load_natural_elbow` reads."""
        model = ArmModel(self.arm, tuple(f"human_{i}" for i in range(1, 8)), "human_arm", "")
        members, width = self.nets.first.shape[:2]
        facts = {"members": int(members), "width": int(width), "arm": model_content(model)}
        policy_files.write(path, _KIND, facts, self.nets)


def load_natural_elbow(path: str | os.PathLike[str]) -> NaturalElbow:
    """Reads what :meth:`NaturalElbow.save` wrote.

    Args:
        path: The file.

    Returns:
        The same elbows, bit for bit.

    Raises:
        FileFormatError: Not such a file.
        OSError: It cannot be read.
    """
    header = policy_files.read_header(path, _KIND)
    nets = make_networks(jax.random.key(0), header["members"], header["width"])
    return NaturalElbow(policy_files.read(path, nets), model_from_content(header["arm"]).arm)


def hand_features(arm: Arm, position: Array, rotation: Array) -> Array:
    """What the network sees of hand poses, ``(22, *batch)``.

    Where the hand is in arm lengths, how far, how it is turned, and how it is turned against the elbow's circle.
    """
    reach = jnp.linalg.norm(arm.elbow - arm.shoulder) + jnp.linalg.norm(arm.wrist - arm.elbow)
    where = position / reach.astype(position.dtype)
    line = unit(position)
    circle = jnp.stack([line, *_reference(arm, line)], axis=-2)
    turned = [m.reshape(*m.shape[:-2], 9) for m in (rotation, circle @ rotation)]
    far = jnp.linalg.norm(where, axis=-1, keepdims=True)
    return jnp.moveaxis(jnp.concatenate([where, far, *turned], axis=-1), -1, 0)


def elbow_circle(arm: Arm, target: Pose) -> tuple[Array, Array, Array]:
    """Center of the elbow's circle and the vectors to its points at swivel 0 and 90 degrees, ``(*batch, 3)`` each.

    From three solutions of the closed form, which three points of a circle are enough for.

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
    """Untrained networks with a leading axis."""
    keys = jax.random.split(key, members)

    def one(key: Array) -> WaypointNet:
        net = WaypointNet(FEATURES, 3, width, _LAYERS, key)
        # Without a first guess the direction of a zero output has no slope to learn in.
        return eqx.tree_at(lambda n: n.last, net, jax.random.normal(key, net.last.shape, jnp.float32) / width**0.5)

    return eqx.filter_vmap(one)(keys)


def across(pull: Array, line: Array) -> Array:
    """The direction of a pull across a line, ``(3, ...)``: the point of the elbow's circle that gives way most."""
    part = pull - jnp.sum(pull * line, axis=0) * line
    return part / jnp.sqrt(jnp.sum(part**2, axis=0) + 1e-6)


def _reference(arm: Arm, line: Array) -> tuple[Array, Array]:
    """Directions of swivel 0 and 90 degrees across lines ``(*batch, 3)``."""
    n = jnp.moveaxis(line, -1, 0)
    pole, first = (v.astype(n.dtype).reshape(3, *(1,) * (n.ndim - 1)) for v in arm.reference.vectors())
    zero, _ = StereographicReference(pole, first).zero_direction(n, tolerances(n.dtype))
    return jnp.moveaxis(zero, 0, -1), jnp.moveaxis(vec3.cross(n, zero), 0, -1)


def unit(v: Array) -> Array:
    """Directions of vectors ``(*batch, 3)``; smooth at zero."""
    return v / jnp.sqrt(jnp.sum(v**2, axis=-1, keepdims=True) + 1e-12)
