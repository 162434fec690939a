"""Exceptions of the library, under one root."""


class JaxikError(Exception):
    """Root of the library's exceptions."""


class ArmClassError(JaxikError, ValueError):
    """The arm does not belong to a class that is solved; the message says which condition fails and by how much."""


class FileFormatError(JaxikError, ValueError):
    """A file is malformed; the message names the file, the line and what was expected."""


class UnreachableError(JaxikError, ValueError):
    """No feasible posture or plan; the message names the first row without one, the reason and the next step."""


class MissingExtraError(JaxikError, ImportError):
    """An optional dependency is missing; the message gives the pip command that installs it."""


class JaxikWarning(UserWarning):
    """Something is taken as it is but looks wrong or is incomplete; the message says what and what to check."""
