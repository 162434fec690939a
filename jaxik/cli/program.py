"""Find the subcommand among the entry points of the installed packages, run it, and report errors in one sentence.

A subcommand is a function whose signature tyro converts to options; it returns an exit code or None. As entry points,
the commands of other packages are not imported here, and only the requested one is loaded. The entry point of a command
of two words, which lets several packages extend one verb, joins the words with a dash.
"""

import inspect
import os
import signal
import sys
import textwrap
import traceback
import warnings
from collections.abc import Callable, Sequence
from functools import partial
from importlib.metadata import EntryPoint, entry_points, version
from pathlib import Path
from typing import Any

from jaxik.errors import JaxikError, JaxikWarning, MissingExtraError

GROUP = "jaxik.commands"
OK, FAILED, USAGE, INTERRUPTED = 0, 1, 2, 130

Command = Callable[..., int | None]


def main() -> int:
    """Run the program with double precision and a compilation cache; the entry point of ``jaxik``."""
    import jax

    jax.config.update("jax_enable_x64", True)
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
        jax.config.update("jax_compilation_cache_dir", str(Path(home) / "jaxik"))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.02)
    code = run(sys.argv[1:])
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # one more Ctrl-C on the way out would change the exit code
    return code


def run(arguments: Sequence[str]) -> int:
    """Run one command line.

    Args:
        arguments: Arguments after the program's name.

    Returns:
        Exit code: 0 success, 1 failure with one sentence on the error stream, 2 wrong usage, 130 stopped by Ctrl-C.
    """
    words = [word for word in arguments if word != "--debug"]
    debug = len(words) < len(arguments)
    commands = {point.name: point for point in entry_points(group=GROUP)}
    if not words or words[0] in ("-h", "--help"):
        print(_overview(commands))
        return OK if words else USAGE
    if words[0] == "--version":
        print(f"jaxik {version('jaxik')}")
        return OK
    if len(words) > 1 and f"{words[0]}-{words[1]}" in commands:
        words = [f"{words[0]}-{words[1]}", *words[2:]]
    if words[0] not in commands:
        _print_error(f"jaxik: no command {words[0]!r}; there are {', '.join(map(_typed, sorted(commands)))}")
        return USAGE
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("always", JaxikWarning)
            warnings.showwarning = partial(_show_warning, warnings.showwarning, _typed(words[0]))
            return _call(commands[words[0]], words)
    except KeyboardInterrupt:
        _print_error(f"jaxik {_typed(words[0])}: stopped")
        return INTERRUPTED
    except Exception as error:
        if debug:
            traceback.print_exc()
        _print_error(f"jaxik {_typed(words[0])}: {_sentence(error)}{'' if debug else _hint(error)}")
        return FAILED


def _call(point: EntryPoint, words: Sequence[str]) -> int:
    """Load a command and call it with its options."""
    try:
        import tyro
    except ImportError as error:
        raise MissingExtraError('the command line needs tyro and rich: pip install "jaxik[cli]"') from error
    command: Command = point.load()
    try:
        return tyro.cli(command, prog=f"jaxik {_typed(words[0])}", args=list(words[1:])) or OK
    except SystemExit as end:  # --help, or wrong usage, which tyro has reported
        return end.code if isinstance(end.code, int) else USAGE


def _overview(commands: dict[str, EntryPoint]) -> str:
    """Text of ``jaxik --help``."""
    lines = ["usage: jaxik COMMAND [--help] [--debug] [options]", ""]
    for name in sorted(commands):
        try:
            text = inspect.getdoc(commands[name].load()) or ""
        except ImportError as error:
            text = f"not available: {error}"
        summary = text.splitlines()[0] if text else ""
        lines.append(textwrap.fill(f"  {_typed(name):<18} {summary}", 80, subsequent_indent=" " * 21))
    return "\n".join([*lines, "", "jaxik COMMAND --help shows the options of a command; start with jaxik demo."])


def _typed(name: str) -> str:
    """Name of a command as it is typed."""
    return name.replace("-", " ")


def _sentence(error: Exception) -> str:
    """The error on one line."""
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    text = " ".join(str(error).split())
    return text if isinstance(error, JaxikError | ValueError) else f"{type(error).__name__}: {text}"


def _hint(error: Exception) -> str:
    """Pointer to ``--debug`` for unexpected errors."""
    return "" if isinstance(error, JaxikError | ValueError | OSError) else " (use --debug for details)"


def _show_warning(
    other: Callable[..., None], command: str, message: Warning | str, category: type[Warning], *where: Any, **more: Any
) -> None:
    """Print the library's own warnings as a sentence, and others as Python does."""
    if issubclass(category, JaxikWarning):
        _print_error(f"jaxik {command}: warning: {message}")
    else:
        other(message, category, *where, **more)


def _print_error(sentence: str) -> None:
    """Print one sentence to the error stream."""
    print(sentence, file=sys.stderr)
