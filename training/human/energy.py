"""``move like a person``: a natural elbow as an energy that a plan can make small."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from jaxik.arm import Arm
from jaxik.energy import Energy, Term, node_weights
from jaxik.kinematics import forward_kinematics, joint_positions
from jaxik.targets import Pose
from training.human.natural_elbow import NaturalElbow


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Naturalness(Term):
    """Σ_k |elbow(q_k) - natural elbow(hand_k)|² / upper arm² dt_k: how far from where a person's elbow would be."""

    policy: NaturalElbow
    person: Float[Array, "3 3"]

    name = "unnaturalness"
    unit = "s"
    formula = "Σ |elbow(q[k]) - natural elbow(hand[k])|² / upper² dt"
    separable = True

    def total(self, arm: Arm, q: Array, time: Array) -> Array:
        """See :class:`jaxik.energy.Term`."""
        return jnp.sum(node_weights(time) * self.rest_rate(arm, q))

    def rest_rate(self, arm: Arm, q: Array) -> Array:
        """Squared distance from the natural elbow, in upper arms."""
        points = joint_positions(arm, q)
        person = jnp.asarray(self.person, q.dtype)
        shoulder, elbow, wrist = (points[..., i, :] for i in range(3))
        upper = jnp.linalg.norm(arm.elbow - arm.shoulder)
        reach = upper + jnp.linalg.norm(arm.wrist - arm.elbow)
        human = self.policy.arm.astype(q.dtype)
        human_reach = jnp.linalg.norm(human.elbow) + jnp.linalg.norm(human.wrist - human.elbow)
        hand = Pose(
            (wrist - shoulder) @ person.T * (human_reach / reach).astype(q.dtype),
            person @ forward_kinematics(arm, q).rotation @ self._hand(person),
        )
        toward = self.policy.direction(hand.position, hand.rotation) @ person
        # Both elbows as directions across the line from shoulder to wrist: arms of other proportions compare by those.
        line = _unit(wrist - shoulder)
        offset = elbow - shoulder
        across = offset - jnp.sum(offset * line, axis=-1, keepdims=True) * line
        radius = jnp.sqrt(jnp.sum(across**2, axis=-1, keepdims=True) + 1e-12)
        return jnp.sum((across - radius * toward) ** 2, axis=-1) / upper**2

    @staticmethod
    def _hand(person: Array) -> Array:
        """What turns a mirrored hand back into a right-handed frame: x towards the thumb changes its sign twice."""
        mirrored = jnp.where(jnp.linalg.det(person) < 0, -1.0, 1.0).astype(person.dtype)
        return jnp.diag(jnp.stack([jnp.ones_like(mirrored), mirrored, jnp.ones_like(mirrored)]))


def human_elbow(policy: NaturalElbow, *, side: str = "right", person: np.ndarray | None = None) -> Energy:
    """The energy of moving unlike a person, for :func:`jaxik.plan`.

    Args:
        policy: Trained on recorded arms, see :func:`training.train_human`.
        side: ``"right"``, or ``"left"`` for the mirror image of the recorded arms.
        person: Rotation from the arm's base frame to the person's (x forward, y left, z up), ``(3, 3)``; None where
            they agree, as for the Meccanoid.

    Returns:
        The energy; its unit is seconds: an elbow one upper arm away costs one a second. Add it to another with a
        weight: ``jaxik.energy.joint_motion() + 2.0 * training.human_elbow(policy)``.

    Raises:
        ValueError: Neither side.

    **Differentiability**: smooth, but where elbow or votes have no direction.
    """
    if side not in ("left", "right"):
        raise ValueError(f'side must be "left" or "right", got {side!r}')
    frame = np.eye(3) if person is None else np.asarray(person, float)
    mirror = np.diag([1.0, -1.0, 1.0]) if side == "left" else np.eye(3)
    return Energy((Naturalness(policy, jnp.asarray(mirror @ frame)),), (1.0,))


def _unit(v: Array) -> Array:
    return v / jnp.sqrt(jnp.sum(v**2, axis=-1, keepdims=True) + 1e-12)
