"""Bodies of arms named on the command line."""

from jaxik.arm import ArmModel
from jaxik.cli.inputs import InputError, is_urdf, urdf_ends
from jaxik.obstacles import Body, with_body

_OVERHANG = 0.03  # of spheres beyond the shapes of a URDF [m]: 60 for a Panda, and each takes time


def find_body(model: ArmModel, name: str, base: str | None = None, tip: str | None = None) -> ArmModel:
    """Return an arm with its body: that of a preset, or the collision shapes of its URDF file.

    Args:
        model: The arm.
        name: The arm as named: a preset, or a file.
        base: Base link in a URDF file.
        tip: Tip link in a URDF file.

    Raises:
        InputError: There is no body for this arm.
    """
    if is_urdf(name):
        return with_body(model, Body.from_urdf(name, *urdf_ends(name, base, tip), overhang=_OVERHANG))
    try:
        return with_body(model, Body.preset(model.name))
    except ValueError as error:
        raise InputError(f"--world needs the arm's body: {error}; a URDF file with collision shapes has one") from None
