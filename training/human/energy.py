"""Distance from a person's elbow as an energy, so that a plan moves the arm like a person."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike
from jaxtyping import Float

from jaxik.arm import Arm
from jaxik.energy import Energy, Term, node_weights
from jaxik.kinematics import forward_kinematics, joint_positions
from training.human.natural_elbow import NaturalElbow, natural_direction, person_frame, unit


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Naturalness(Term):
    """Σ_k |elbow(q_k) - natural elbow(hand_k)|² / upper arm² dt_k: squared distance from a person's elbow.

    Attributes:
        policy: Predicts a person's elbow from the hand.
        person: Rotation from the arm's base frame to the person's, ``(3, 3)``; with determinant -1 for the left arm.
    """

    policy: NaturalElbow
    person: Float[Array, "3 3"]

    name = "unnaturalness"
    unit = "s"
    formula = "Σ |elbow(q[k]) - natural elbow(hand[k])|² / upper² dt"
    separable = True
    paddable = True

    def total(self, arm: Arm, q: Array, time: Array) -> Array:
        """See :class:`jaxik.energy.Term`."""
        return jnp.sum(node_weights(time) * self.rest_rate(arm, q))

    def rest_rate(self, arm: Arm, q: Array) -> Array:
        """Return the squared distance from the natural elbow, in units of the squared upper-arm length."""
        points = joint_positions(arm, q)
        shoulder, elbow, wrist = (points[..., i, :] for i in range(3))
        upper = jnp.linalg.norm(arm.elbow - arm.shoulder)
        hand = forward_kinematics(arm, q).rotation
        toward = natural_direction(self.policy, arm, wrist - shoulder, hand, jnp.asarray(self.person))
        # Compare the elbows' directions perpendicular to the line from shoulder to wrist: they do not depend on the
        # proportions of the arm.
        line = unit(wrist - shoulder)
        offset = elbow - shoulder
        across = offset - jnp.sum(offset * line, axis=-1, keepdims=True) * line
        radius = jnp.sqrt(jnp.sum(across**2, axis=-1, keepdims=True) + 1e-12)
        return jnp.sum((across - radius * toward) ** 2, axis=-1) / upper**2


def human_elbow(policy: NaturalElbow, *, side: str = "right", person: ArrayLike | None = None) -> Energy:
    """Return the energy of moving unlike a person, for :func:`jaxik.plan`.

    Args:
        policy: Trained on recorded arms, see :func:`training.train_human`.
        side: ``"right"``, or ``"left"`` for the mirror image of the recorded arms.
        person: Rotation from the arm's base frame to the person's (x forward, y left, z up), ``(3, 3)``; None if the
            frames agree, as for the Meccanoid.

    Returns:
        The energy [s]: an elbow at a distance of one upper arm costs 1 per second. Add it to another energy with a
        factor: ``jaxik.energy.joint_motion() + 2.0 * training.human_elbow(policy)``.

    Raises:
        ValueError: ``side`` is neither of the two.

    **Differentiability**: smooth, except where the elbow or the predicted direction is undefined.
    """
    return Energy((Naturalness(policy, person_frame(side, person)),), (1.0,))
