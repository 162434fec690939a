"""Exceptions of the hardware package, under one root."""

from jaxik.errors import JaxikError


class HardwareError(JaxikError):
    """Root of all errors between a trajectory and the servos."""


class CalibrationError(HardwareError, ValueError):
    """Calibration that is invalid or lacks a joint; the message names file, joint and what was expected."""


class BoardError(HardwareError):
    """Board that cannot be opened or refuses a command; the message lists likely causes, most likely first."""


class LinkError(HardwareError, OSError):
    """Board that stopped answering."""


class ServoError(HardwareError):
    """Servo that reports a fault of its own, such as overload, or no longer does what it was told."""


class PlaybackError(HardwareError):
    """Playback that did not succeed; the message says how it ended and what to do next."""
