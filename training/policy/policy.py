"""The elbow policy: the fast planner with a learned correction, at about a thousandth of a plan's cost.

The fast planner (:mod:`jaxik.planning.fast`) finds the best candidate of every path; a network, which sees the closed
form there and the next Gauss-Newton step, corrects it.
"""

import os

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike
from jaxtyping import Float, PRNGKeyArray

from jaxik import energy as energies
from jaxik.arm import Arm, ArmModel, as_arm, model_content, model_from_content
from jaxik.energy import Energy, JointMotion
from jaxik.obstacles import Body, World, with_body
from jaxik.planning import BatchMotion, plan_batch
from jaxik.planning.fast import CANDIDATES, Candidate, PathBatch, motion_weights
from jaxik.targets import Target
from training import network_files
from training.policy.features import feature_count, path_features
from training.waypoint_net import WaypointNet

_KIND = "elbow-policy"
_CORRECTION = 0.3  # swivel that an output of one stands for [rad]
_DILATIONS = (1, 2, 4)  # knots: together they see half of a trained path


class ElbowPolicy(eqx.Module):
    """A planner learned for one arm and one energy.

    Attributes:
        net: The network, all that is trained.
        arm: The arm it was trained for, in single precision.
        weights: Weights of the joints' squared motion in the energy, ``(joint,)``.
        motion_alone: True where the energy is joint motion alone, so that motions can be judged by it.
    """

    net: WaypointNet
    arm: Arm
    weights: Float[Array, "joint"]
    motion_alone: bool = eqx.field(static=True, default=True)

    def corrected(self, candidate: Candidate, features: Array) -> Array:
        """Return the corrected swivels at the knots, ``(K, B)`` [rad].

        Args:
            candidate: The best candidate of every path.
            features: Its features, ``(features, K, B)``.

        **Differentiability**: in the network's weights.
        """
        share, more = self.net(features)
        return candidate.swivel + (1.0 + share) * candidate.step + _CORRECTION * more

    def answer(self, batch: PathBatch, candidate: Candidate) -> Array:
        """Return the corrected swivels of a batch, for :func:`jaxik.plan_batch`, ``(K, B)`` [rad].

        Args:
            batch: The paths at their knots.
            candidate: The best candidate of every path.
        """
        return self.corrected(candidate, path_features(batch, candidate))

    def __call__(
        self,
        target: Target,
        time: Float[ArrayLike, "*batch waypoint"],
        *,
        start: Float[ArrayLike, "*batch joint"] | None = None,
        approach_time: Float[ArrayLike, ""] = 1.0,
        knots: int | None = None,
        candidates: int = CANDIDATES,
        body: Body | None = None,
        world: World | None = None,
    ) -> BatchMotion:
        """Plan motions along paths; for the other arguments see :func:`jaxik.plan_batch`.

        Args:
            target: K targets per path, leading axes ``(*batch, K)``.
            time: Increasing times, ``(*batch, K)`` [s].
            start: Postures that the arms come from, ``(*batch, joint)`` [rad].
            approach_time: Time for the approach from them [s].
            knots: Waypoints at which the planner decides.
            candidates: Basins that are tried.
            body: Body of the arm, which the policy does not hold; the network does not see it either.
            world: Obstacles that the body keeps clear of.
        """
        return plan_batch(
            self.arm if body is None else with_body(self.arm, body),
            target,
            time,
            energy=energies.joint_motion(self.weights),
            start=start,
            approach_time=approach_time,
            correct=self.answer,
            by_motion=self.motion_alone,
            knots=knots,
            candidates=candidates,
            world=world,
        )


def make_policy(
    arm: Arm | ArmModel, *, key: PRNGKeyArray, energy: Energy | None = None, width: int = 16
) -> ElbowPolicy:
    """Return an untrained policy, which plans as :func:`jaxik.plan_batch` does.

    Args:
        arm: The arm.
        key: Key of the random weights.
        energy: Energy to minimize; None for :func:`jaxik.energy.joint_motion`.
        width: Width of the hidden layers.
    """
    arm = as_arm(arm).astype(jnp.float32)
    energy = energies.joint_motion() if energy is None else energy
    motion_alone = all(isinstance(term, JointMotion) for term in energy.terms)
    net = WaypointNet(feature_count(arm), 2, width, _DILATIONS, key)
    return ElbowPolicy(net, arm, motion_weights(arm, energy), motion_alone)


def save_policy(policy: ElbowPolicy, path: str | os.PathLike[str]) -> None:
    """Write a policy with its arm; :func:`load_policy` gives the same bits back.

    Args:
        policy: The policy.
        path: File to write.

    Raises:
        OSError: It cannot be written.
    """
    model = ArmModel(policy.arm, tuple(f"joint_{i + 1}" for i in range(policy.arm.n_joints)), "", "")
    facts = {
        "arm": model_content(model),
        "weights": np.asarray(policy.weights, float).tolist(),
        "width": int(policy.net.first.shape[0]),
        "motion_alone": policy.motion_alone,
    }
    network_files.write(path, _KIND, facts, policy.net)


def load_policy(path: str | os.PathLike[str]) -> ElbowPolicy:
    """Read a policy that :func:`save_policy` wrote.

    Args:
        path: The file.

    Returns:
        The policy with its arm.

    Raises:
        FileFormatError: Not such a file.
        OSError: It cannot be read.
    """
    header = network_files.read_header(path, _KIND)
    arm = model_from_content(header["arm"]).arm
    like = make_policy(arm, key=jax.random.key(0), width=header["width"])
    net = network_files.read(path, like.net)
    return ElbowPolicy(net, arm, jnp.asarray(header["weights"], jnp.float32), header["motion_alone"])
