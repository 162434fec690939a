"""Every exception of the playing side, under one root."""

from jaxik.errors import JaxikError


class HardwareError(JaxikError):
    """Root: something between the trajectory and the servos."""


class CalibrationError(HardwareError, ValueError):
    """The calibration is none or does not fit the trajectory; names file, joint and what was expected."""


class BoardError(HardwareError):
    """No such board, or it does not answer as it should; lists likely causes in order."""


class LinkError(HardwareError, OSError):
    """The board stopped answering."""
