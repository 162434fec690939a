"""Every exception jaxik raises on purpose, under one root."""


class JaxikError(Exception):
    """Root of the library's own exceptions."""


class ArmClassError(JaxikError, ValueError):
    """The arm is not a member of the S-R-S class; the message says which condition fails and by how much."""


class FileFormatError(JaxikError, ValueError):
    """A file does not hold what it should; the message names file, line and what was expected."""


class UnreachableError(JaxikError, ValueError):
    """Asked for a posture that no branch and no swivel provides; carries the indices and the reasons."""


class MissingExtraError(JaxikError, ImportError):
    """An optional dependency is absent; the message carries the pip line that installs it."""
