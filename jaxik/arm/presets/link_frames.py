"""Mass data given in link frames, as URDF files have it, in the base frame at zero joint angles."""

import numpy as np

from jaxik.arm.arm import LinkInertia
from jaxik.arm.builder import Numbers, floats

_FULL = [0, 1, 2, 1, 3, 4, 2, 4, 5]
"""Places in (ixx, ixy, ixz, iyy, iyz, izz) of the symmetric matrix, row by row."""


def links_of_frames(frames: np.ndarray, mass: Numbers, centers: Numbers, tensors: Numbers) -> LinkInertia:
    """Return the mass data of links whose frames at zero joint angles are known.

    Args:
        frames: Frames of the links in the base frame, ``(joint, 4, 4)``.
        mass: Masses [kg].
        centers: Centers of mass in the link frames, ``(joint, 3)`` [m].
        tensors: Entries ixx, ixy, ixz, iyy, iyz and izz of the inertias about these, along the link frames' axes,
            ``(joint, 6)`` [kg m²].
    """
    turn, origin = frames[:, :3, :3], frames[:, :3, 3]
    full = np.array(tensors)[:, _FULL].reshape(-1, 3, 3)
    return LinkInertia(
        floats(np.array(mass)),
        floats(np.einsum("lij,lj->li", turn, np.array(centers)) + origin),
        floats(np.einsum("lij,ljk,lmk->lim", turn, full, turn)),
    )
