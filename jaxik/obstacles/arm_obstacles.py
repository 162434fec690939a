"""An arm as an obstacle of another: the spheres of its body at its postures."""

import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Float

from jaxik.arm import Arm, ArmModel, as_arm
from jaxik.numerics import to_batch_first, to_batch_last
from jaxik.obstacles.clearance import sphere_centers
from jaxik.obstacles.surroundings import in_world
from jaxik.obstacles.world import World
from jaxik.targets import Pose, as_array, as_floats, check_joints


def as_obstacles(arm: Arm | ArmModel, q: Float[ArrayLike, "*batch joint"], *, base: Pose | None = None) -> World:
    """Return the spheres of an arm's body at its postures as a world for another arm.

    Args:
        arm: The arm with its body (:func:`jaxik.with_body`).
        q: Its joint angles, ``(*batch, n_joints)`` [rad]; along a motion one world per waypoint.
        base: Pose of its base frame in that of the other arm; None for the same frame.

    Returns:
        The world, its batch axes those of ``q``.

    Raises:
        ValueError: Wrong shapes, or an arm without a body.

    **Differentiability**: in ``q``, ``base`` and the body.

    Example:
        >>> import jax.numpy as jnp
        >>> import jaxik
        >>> model = jaxik.with_body(jaxik.presets.iiwa14(), jaxik.Body.preset("iiwa14"))
        >>> beside = jaxik.Pose(jnp.array([0.0, 0.8, 0.0]), jnp.eye(3))
        >>> other = jaxik.as_obstacles(model, jnp.zeros(7), base=beside)
        >>> round(float(jaxik.clearance(model, jnp.zeros(7), other).distance), 3) < 0.8
        True
    """
    arm = in_world(as_arm(arm, any_class=True), World())
    (q,) = as_floats(as_array("joint angles of shape (*batch, n_joints)", q))
    check_joints(arm, q)
    batch, arm = q.shape[:-1], arm.astype(q.dtype)
    body = arm.surroundings.body
    place = to_batch_first(sphere_centers(arm, body, to_batch_last(q, batch, 1)), batch)
    centers = jnp.swapaxes(place, -1, -2)
    if base is not None:
        centers = jnp.asarray(base.position, q.dtype) + centers @ jnp.asarray(base.rotation, q.dtype).T
    return World(centers, jnp.broadcast_to(body.radii, centers.shape[:-1]))
