"""Arms for tests: every preset, random members of the whole class, and forward kinematics written independently."""

import jax
import numpy as np

from jaxik.arm import presets
from jaxik.arm.arm import Arm, HalfSpaces, LinkInertia, Motors
from jaxik.arm.builder import floats, make_arm
from jaxik.arm.outer_joint_arm import OuterJointArm
from jaxik.arm.swivel_reference import PaperReference, StereographicReference

ALL_PRESETS = {
    "paper_arm": presets.paper_arm,
    "meccanoid_left": lambda: presets.meccanoid("left"),
    "meccanoid_right": lambda: presets.meccanoid("right"),
    "iiwa7": presets.iiwa7,
    "iiwa14": presets.iiwa14,
}


def random_arm(
    seed: int | np.random.Generator,
    n_joints: int = 7,
    *,
    offset: bool = True,
    skew: bool = True,
    limits: bool = False,
    keep_out: int = 0,
    reference: str = "random",
) -> Arm:
    """A random member of the class.

    Args:
        seed: Seed or generator.
        n_joints: 7, or 6 with the tool's roll free.
        offset: Give the elbow axis a general direction and offsets from both links; otherwise the three joint groups
            are stacked on two straight links that the elbow axis crosses at a right angle.
        skew: Let axis 3 make a random angle with axis 1, and 7 with 5; otherwise they are parallel.
        limits: Random ranges between 0.5 and 3 rad wide around random mid angles; otherwise no limits.
        keep_out: Number of random half-spaces, each of which the elbow can satisfy and violate.
        reference: ``"paper"``, ``"stereographic"`` or ``"random"``.
    """
    rng = np.random.default_rng(seed)
    a1, a2, a3 = _triple(rng, skew)
    a5, a6, a7 = _triple(rng, skew)
    upper, fore, hand = rng.uniform(0.15, 0.6, 3)
    shoulder = rng.uniform(-1, 1, 3)
    if offset:
        a4 = _unit(rng)
        elbow = shoulder + upper * _across(rng, a4)
        wrist = elbow + fore * _across(rng, a4) + rng.uniform(-0.2, 0.2) * a4
    else:
        a4 = _across(rng, a3)
        turn = _rotation_to(a5, _across(rng, a4))
        a5, a6, a7 = turn @ a5, turn @ a6, turn @ a7
        elbow = shoulder + upper * a3
        wrist = elbow + fore * a5
    if n_joints == 6:
        z = a7
        tool_rotation = np.stack([np.cross(a6, z), a6, z], axis=1)
        tool = wrist + hand * z
    else:
        tool_rotation = random_rotation(rng)
        tool = wrist + hand * _unit(rng)
    axes = np.stack([a1, a2, a3, a4, a5, a6, a7])[:n_joints]
    mid, half = rng.uniform(-2, 2, n_joints), rng.uniform(0.25, 1.5, n_joints)
    normals = np.stack([_unit(rng) for _ in range(keep_out)]) if keep_out else np.zeros((0, 3))
    kind = str(rng.choice(["paper", "stereographic"])) if reference == "random" else reference
    first = _unit(rng)
    second = _across(rng, first)
    factor = rng.normal(size=(n_joints, 3, 3))
    mass = rng.uniform(0.1, 2, n_joints)
    return make_arm(
        axes,
        shoulder,
        elbow,
        wrist,
        tool,
        tool_rotation,
        lower=mid - half if limits else None,
        upper=mid + half if limits else None,
        velocity_limit=rng.uniform(1, 4, n_joints),
        torque_limit=rng.uniform(1, 100, n_joints),
        links=LinkInertia(
            floats(mass),
            floats(shoulder + rng.uniform(-0.5, 0.5, (n_joints, 3))),
            floats(1e-2 * factor @ factor.transpose(0, 2, 1)),
        ),
        motors=Motors(floats(rng.uniform(0.5, 8, n_joints)), floats(rng.uniform(0.2, 5, n_joints))),
        gravity=9.81 * _unit(rng),
        keep_out=HalfSpaces(floats(normals), floats(normals @ shoulder + upper * rng.uniform(-0.5, 0.8, keep_out))),
        reference=(
            PaperReference(floats(first), floats(second))
            if kind == "paper"
            else StereographicReference(floats(first), floats(second))
        ),
    )


def random_angles(arm: Arm, rng: np.random.Generator, count: int) -> np.ndarray:
    """Joint angles inside the limits, at most half a turn from zero, ``(count, joint)``."""
    low = np.maximum(np.asarray(arm.lower, np.float64), -np.pi)
    high = np.minimum(np.asarray(arm.upper, np.float64), np.pi)
    return rng.uniform(np.minimum(low, high), np.maximum(low, high), (count, len(low)))


def reference_fk(arm: Arm, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tool position and rotation by the product of exponentials, in numpy float64, one posture at a time."""
    group = [arm.shoulder] * 3 + [arm.elbow] + [arm.wrist] * 3
    if isinstance(arm, OuterJointArm):
        group[arm.outer_joint] = arm.outer
    positions, rotations = [], []
    for angles in np.atleast_2d(q):
        position, rotation = np.asarray(arm.tool_position, np.float64), np.asarray(arm.tool_rotation, np.float64)
        for i in reversed(range(len(angles))):
            turn = rotation_about(np.asarray(arm.axes[i], np.float64), angles[i])
            point = np.asarray(group[i], np.float64)
            position, rotation = point + turn @ (position - point), turn @ rotation
        positions.append(position)
        rotations.append(rotation)
    return np.stack(positions), np.stack(rotations)


def rotation_about(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rotation matrix about a unit axis (Rodrigues)."""
    hat = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + np.sin(angle) * hat + (1 - np.cos(angle)) * hat @ hat


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    """A uniformly random rotation matrix."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


def same_bits(a: object, b: object) -> bool:
    """Whether two pytrees have equal structure and equal bytes in every leaf."""
    leaves_a, tree_a = jax.tree.flatten(a)
    leaves_b, tree_b = jax.tree.flatten(b)
    return tree_a == tree_b and all(
        x.dtype == y.dtype and x.shape == y.shape and np.asarray(x).tobytes() == np.asarray(y).tobytes()
        for x, y in zip(leaves_a, leaves_b, strict=True)
    )


def _triple(rng: np.random.Generator, skew: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    middle = _unit(rng)
    first = _across(rng, middle)
    return first, middle, _across(rng, middle) if skew else first


def _unit(rng: np.random.Generator) -> np.ndarray:
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def _across(rng: np.random.Generator, axis: np.ndarray) -> np.ndarray:
    """A random unit vector perpendicular to an axis."""
    v = np.cross(axis, _unit(rng))
    return v / np.linalg.norm(v)


def _rotation_to(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Some rotation that carries unit vector a to unit vector b."""
    k = np.cross(a, b)
    return rotation_about(k / np.linalg.norm(k), float(np.arctan2(np.linalg.norm(k), a @ b)))
