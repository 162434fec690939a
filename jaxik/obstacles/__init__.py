"""The arm's body and the obstacles about it: what they leave of the elbow's circle, and how far they are."""

from jaxik.obstacles.arm_obstacles import as_obstacles
from jaxik.obstacles.body import Body
from jaxik.obstacles.clearance import (
    Clearance,
    clearance,
    closeness,
    closest_pair,
    columns_of,
    least_room,
    meets,
    room_at_nodes,
    rooms,
    rooms_at,
    sphere_centers,
)
from jaxik.obstacles.free_swivels import FreeSwivels, RigidParts, free_swivels
from jaxik.obstacles.surroundings import Surroundings, in_columns, in_rows, in_world, moves, with_body
from jaxik.obstacles.world import World
from jaxik.obstacles.world_files import load_world, save_world

__all__ = [
    "Body",
    "Clearance",
    "FreeSwivels",
    "RigidParts",
    "Surroundings",
    "World",
    "as_obstacles",
    "clearance",
    "closeness",
    "closest_pair",
    "columns_of",
    "free_swivels",
    "in_columns",
    "in_rows",
    "in_world",
    "least_room",
    "load_world",
    "meets",
    "moves",
    "room_at_nodes",
    "rooms",
    "rooms_at",
    "save_world",
    "sphere_centers",
    "with_body",
]
