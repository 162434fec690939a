"""Messages of ROS 2 as plain values and as YAML or JSON, without an installation of ROS."""

import json
from collections.abc import Mapping
from typing import Any

from jaxik.errors import FileFormatError, MissingExtraError

NANOSECONDS = 1_000_000_000
_CLOCKS = (("sec", "nanosec"), ("secs", "nsecs"))  # ROS 2, ROS 1


def as_yaml(message: Any, *, one_line: bool = False) -> str:
    """Return a message as YAML, as `ros2 topic pub` and `ros2 action send_goal` take it.

    JSON would not do: the YAML reader of ROS takes its ``1e-05`` for a text.

    Args:
        message: Dictionaries, lists, numbers and texts.
        one_line: Write everything on one line, for an argument of a command.

    Raises:
        MissingExtraError: PyYAML is absent.
    """
    style = {"default_flow_style": True, "width": float("inf")} if one_line else {"default_flow_style": None}
    return _yaml().safe_dump(message, sort_keys=False, allow_unicode=True, **style).strip() + "\n"


def parse_yaml(text: str) -> Any:
    """Return the first document of a YAML text, such as the output of `ros2 topic echo`.

    Args:
        text: The text.

    Raises:
        FileFormatError: It is no YAML.
        MissingExtraError: PyYAML is absent.
    """
    yaml = _yaml()
    try:
        return next(iter(yaml.safe_load_all(text)), None)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise FileFormatError(f"expected YAML; {' '.join(str(error).split())[:200]}") from None


def parse_json(text: str | bytes) -> Any:
    """Return the value of a JSON text.

    Args:
        text: The text.

    Raises:
        FileFormatError: It is no JSON.
    """
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise FileFormatError(f"expected JSON; {' '.join(str(error).split())[:200]}") from None


def member(message: Any, name: str, where: str = "the message") -> Any:
    """Return a field of a message, given as a dictionary or as an object of a ROS package.

    Args:
        message: The message.
        name: Name of the field.
        where: Description of the message, for the error.

    Raises:
        FileFormatError: It has no such field.
    """
    missing = object()
    found = message.get(name, missing) if isinstance(message, Mapping) else getattr(message, name, missing)
    if found is missing:
        raise FileFormatError(f"expected {where} to have the field {name!r}; it has none")
    return found


def has_member(message: Any, name: str) -> bool:
    """Return whether a message has a field (see :func:`member`)."""
    return name in message if isinstance(message, Mapping) else hasattr(message, name)


def real(value: Any, where: str) -> float:
    """Return a number of a message.

    Args:
        value: The number.
        where: Description of it, for the error.

    Raises:
        FileFormatError: It is no number.
    """
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        raise FileFormatError(f"expected a number for {where}; got {value!r:.80}") from None


def stamp(nanoseconds: int) -> dict[str, int]:
    """Return a time as the messages spell it.

    Args:
        nanoseconds: The time [ns].
    """
    sec, nanosec = divmod(int(nanoseconds), NANOSECONDS)
    return {"sec": sec, "nanosec": nanosec}


def nanoseconds(message: Any, where: str) -> int:
    """Return a time or duration of a message [ns], spelled as in ROS 2 or ROS 1.

    Args:
        message: The time or duration.
        where: Description of it, for the error.

    Raises:
        FileFormatError: It is neither.
    """
    for sec, nanosec in _CLOCKS:
        if has_member(message, sec) and has_member(message, nanosec):
            parts = (member(message, sec), member(message, nanosec))
            if all(isinstance(part, int) and not isinstance(part, bool) for part in parts):
                return parts[0] * NANOSECONDS + parts[1]
    raise FileFormatError(f"expected {where} to have whole numbers sec and nanosec; got {message!r:.80}")


def _yaml() -> Any:
    try:
        import yaml
    except ImportError as error:
        raise MissingExtraError('messages as YAML need PyYAML: pip install "jaxik[ros]"') from error
    return yaml
