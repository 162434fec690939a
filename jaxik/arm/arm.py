"""The arm as data: a pytree of arrays, and beside it a model with names and sources.

Arms belong to the S-R-S class: three joints whose axes meet in the shoulder, one elbow joint, and three joints whose
axes meet in the wrist (two where the tool's roll is no joint). Everything is given at zero joint angles in the arm's
base frame.
"""

from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Bool, Float

from jaxik.arm.swivel_reference import SwivelReference
from jaxik.errors import ArmClassError

EVERY_CLASS = (
    "forward_kinematics, joint_positions, jacobian, manipulability, self_motion_direction, the dynamics, solve_ik, "
    "swivel_of, swivel_arcs, solve_nearest, solve_closest, follow and plan"
)
"""Functions that work on arms of every class, as part of a sentence."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class HalfSpaces:
    """Half-spaces the elbow must stay in: ``normal · elbow <= offset`` for each; none are arrays of length 0.

    Attributes:
        normal: Unit vectors that point into the forbidden side, ``(half_spaces, 3)``, in the base frame.
        offset: Distances of the boundaries from the origin along the normals, ``(half_spaces,)`` [m].
    """

    normal: Float[Array, "half_spaces 3"]
    offset: Float[Array, "half_spaces"]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class LinkInertia:
    """Mass data of the moving links; link i lies between joints i and i + 1.

    Attributes:
        mass: Masses, ``(joint,)`` [kg].
        center_of_mass: Centers of mass at zero joint angles in the base frame, ``(joint, 3)`` [m].
        inertia: Inertias about the centers of mass along the base frame's axes, at zero joint angles,
            ``(joint, 3, 3)`` [kg m²].
    """

    mass: Float[Array, "joint"]
    center_of_mass: Float[Array, "joint 3"]
    inertia: Float[Array, "joint 3 3"]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Motors:
    """Electrical data of the motors as seen at the joints, gears included.

    Attributes:
        resistance: Winding resistances, ``(joint,)`` [ohm].
        torque_constant: Joint torque per ampere, ``(joint,)`` [N m/A].
    """

    resistance: Float[Array, "joint"]
    torque_constant: Float[Array, "joint"]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Arm:
    """An S-R-S arm: geometry, limits, masses, motors, the elbow's keep-out and the reference of its swivel.

    Build one with :func:`jaxik.make_arm`, a preset or :func:`jaxik.load_urdf`, which check the class conditions. Every
    field is an array, so an arm is batched, differentiated and passed through ``jit`` like any other value.

    Attributes:
        axes: Unit joint axes, ``(joint, 3)``; 7 joints, or 6 where the tool's roll is not a joint.
        shoulder: Point S where axes 1-3 meet, ``(3,)`` [m].
        elbow: Point E on axis 4 nearest to S, ``(3,)`` [m].
        wrist: Point W where axes 5-7 meet, ``(3,)`` [m].
        tool_position: Tool point at zero joint angles, ``(3,)`` [m].
        tool_rotation: Tool frame at zero joint angles, ``(3, 3)``; its z axis is the pointing direction.
        lower: Lower joint limits, ``(joint,)`` [rad].
        upper: Upper joint limits, ``(joint,)`` [rad].
        velocity_limit: Largest joint speeds, ``(joint,)`` [rad/s].
        torque_limit: Largest joint torques, ``(joint,)`` [N m].
        links: Mass data.
        motors: Motor data.
        gravity: Gravity in the base frame, ``(3,)`` [m/s²].
        keep_out: Half-spaces the elbow must stay in.
        reference: Zero of the swivel angle.
        surroundings: The body of the arm and the world about it, set by :func:`jaxik.with_body`; None for none.
    """

    axes: Float[Array, "joint 3"]
    shoulder: Float[Array, "3"]
    elbow: Float[Array, "3"]
    wrist: Float[Array, "3"]
    tool_position: Float[Array, "3"]
    tool_rotation: Float[Array, "3 3"]
    lower: Float[Array, "joint"]
    upper: Float[Array, "joint"]
    velocity_limit: Float[Array, "joint"]
    torque_limit: Float[Array, "joint"]
    links: LinkInertia
    motors: Motors
    gravity: Float[Array, "3"]
    keep_out: HalfSpaces
    reference: SwivelReference
    surroundings: Any = field(default=None, kw_only=True)  # of a room below: jaxik.obstacles.Surroundings

    @property
    def n_joints(self) -> int:
        """Number of joints: 7, or 6 where the tool's roll is not a joint."""
        return self.axes.shape[-2]

    @property
    def kinematic_class(self) -> str:
        """Name of the class: ``"S-R-S"``."""
        return "S-R-S"

    @property
    def closed_form(self) -> bool:
        """True where all solutions are found in closed form; False for :class:`jaxik.RefinedArm`."""
        return True

    @property
    def stations(self) -> tuple[Array, ...]:
        """Points from base to tip that the joints carry along, the tool point last, ``(3,)`` each [m]."""
        return self.shoulder, self.elbow, self.wrist, self.tool_position

    @property
    def station_of_joint(self) -> tuple[int, ...]:
        """Index of the station that lies on each joint's axis."""
        return (0, 0, 0, 1, 2, 2, 2)[: self.n_joints]

    @property
    def turning(self) -> Bool[Array, "joint"]:
        """Joints whose range exceeds a full turn, ``(joint,)``, so that the short way round is open to them.

        Their limits still hold for the angle itself. A range of exactly one turn, rounded in either float type, does
        not count: its two ends are the same posture, but the limits do not let the joint pass it.
        """
        return self.upper - self.lower > 2 * np.pi * (1 + 1e-6)

    @property
    def length(self) -> Float[Array, ""]:
        """Length from station to station up to the tool point [m], the scale of relative tolerances."""
        return _way(*self.stations)

    def astype(self, dtype: DTypeLike) -> "Arm":
        """Return the same arm with other floats.

        Args:
            dtype: Float type of every array.
        """
        return jax.tree.map(lambda x: jnp.asarray(x, dtype), self)


@jax.jit  # read on the host too, where one program is called in the place of ten operations
def _way(*points: Float[Array, "3"]) -> Float[Array, ""]:
    """Length of the way along points."""
    return jnp.sum(jnp.linalg.norm(jnp.diff(jnp.stack(points), axis=0), axis=-1))


@dataclass(frozen=True)
class Gripper:
    """A gripper beyond the arm's joints; it takes no part in the kinematics.

    Attributes:
        name: Joint name.
        lower: Angle of the closed gripper [rad].
        upper: Angle of the open gripper [rad].
    """

    name: str
    lower: float
    upper: float


@dataclass(frozen=True)
class ArmModel:
    """An arm with its names, source and notes; the solver sees only ``.arm``.

    Public functions take either. A model itself is no pytree: pass ``model.arm`` through ``jit`` and ``vmap``.

    Attributes:
        arm: The arrays.
        joint_names: Names of the joints, in order.
        name: Name of the arm.
        source: Source of the numbers.
        notes: Estimates and departures from the source, one sentence each.
        gripper: The gripper joint; None without one.
    """

    arm: Arm
    joint_names: tuple[str, ...]
    name: str
    source: str
    notes: tuple[str, ...] = field(default=())
    gripper: Gripper | None = None

    @property
    def kinematic_class(self) -> str:
        """Name of the arm's class: ``"S-R-S"``, ``"U-R wrist"`` or ``"R-U shoulder"``."""
        return self.arm.kinematic_class


def as_arm(arm: object, *, any_class: bool = False, closed_form: bool = False, instead: str = "") -> Arm:
    """Return the arrays of an arm or of an arm model.

    Args:
        arm: An :class:`Arm`, or an :class:`ArmModel`, whose ``.arm`` is taken.
        any_class: Take arms of every class, for callers that work on them; else S-R-S arms only.
        closed_form: Of these, take only arms with a closed form.
        instead: Advice on the others, as the end of the message.

    Returns:
        One arm; inside ``jax.vmap`` also each of a batch.

    Raises:
        ArmClassError: If it is an arm of a class that the caller does not work on.
        ValueError: If it is anything else, or a batch of arms; says what was got and what to do.

    Example:
        >>> import jaxik
        >>> as_arm(jaxik.presets.iiwa7()).n_joints
        7
    """
    if isinstance(arm, ArmModel):
        arm = arm.arm
    if isinstance(arm, Arm):
        if not any_class and type(arm) is not Arm:
            raise ArmClassError(
                f"this function takes S-R-S arms only, so far; got a {arm.kinematic_class} arm, for which "
                f"{EVERY_CLASS} work"
            )
        if closed_form and not arm.closed_form:
            raise ArmClassError(
                f"this function takes arms with a closed form only, so far; got a {arm.kinematic_class} arm, which is "
                "solved by refinement: solve_ik, swivel_arcs, solve_nearest, solve_closest, follow, fit_path and plan "
                f"work{instead and '; ' + instead}"
            )
        if (rank := getattr(arm.axes, "ndim", None)) == 2:
            return arm
        if rank is not None and rank > 2:
            raise ValueError(
                f"expected one arm, got a batch of arms (axes of shape {arm.axes.shape}); map over it: "
                "jax.vmap(f, in_axes=(0, None))(arms, ...)"
            )
        raise ValueError(f"expected an arm with axes of shape (joint, 3), got {arm.axes!r:.80}; build it with make_arm")
    if callable(arm) and not isinstance(arm, type):
        name = getattr(arm, "__name__", "it")
        raise ValueError(f"expected a jaxik.Arm or jaxik.ArmModel, got the function {name}: call it, {name}()")
    raise ValueError(f"expected a jaxik.Arm or jaxik.ArmModel, such as jaxik.presets.iiwa7(), got {type(arm).__name__}")
