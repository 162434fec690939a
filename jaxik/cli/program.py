"""Finds subcommands among the installed packages' entry points, runs one, and turns errors into sentences.

A subcommand is a function whose signature tyro turns into options; it returns an exit code or None. Being entry
points, the commands of other packages need no import here, and only the one asked for is loaded. A command of two
words, so that several packages can add to one verb, is an entry point whose name joins them with a dash.
"""

import inspect
import os
import sys
import traceback
from collections.abc import Callable, Sequence
from importlib.metadata import EntryPoint, entry_points, version
from pathlib import Path

from jaxik.errors import JaxikError, MissingExtraError

GROUP = "jaxik.commands"
OK, FAILED, USAGE, INTERRUPTED = 0, 1, 2, 130

Command = Callable[..., int | None]


def main() -> int:
    """Entry of the program: double precision and a compilation cache for this process, then :func:`run`."""
    import jax

    jax.config.update("jax_enable_x64", True)
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
        jax.config.update("jax_compilation_cache_dir", str(Path(home) / "jaxik"))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.3)
    return run(sys.argv[1:])


def run(arguments: Sequence[str]) -> int:
    """Runs one command line.

    Args:
        arguments: What follows the program's name.

    Returns:
        Exit code: 0 done, 1 failed with one sentence on the error stream, 2 wrong usage, 130 stopped by Ctrl-C.
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
        _complain(f"jaxik: no command {words[0]!r}; there are {', '.join(map(_spoken, sorted(commands)))}")
        return USAGE
    try:
        return _call(commands[words[0]], words)
    except KeyboardInterrupt:
        _complain(f"jaxik {_spoken(words[0])}: stopped")
        return INTERRUPTED
    except Exception as error:
        if debug:
            traceback.print_exc()
        _complain(f"jaxik {_spoken(words[0])}: {_sentence(error)}{'' if debug else _hint(error)}")
        return FAILED


def _call(point: EntryPoint, words: Sequence[str]) -> int:
    """Loads a command and calls it with its options."""
    try:
        import tyro
    except ImportError as error:
        raise MissingExtraError('the command line needs tyro and rich: pip install "jaxik[cli]"') from error
    command: Command = point.load()
    try:
        return tyro.cli(command, prog=f"jaxik {_spoken(words[0])}", args=list(words[1:])) or OK
    except SystemExit as end:  # --help, or wrong usage, which tyro has explained
        return end.code if isinstance(end.code, int) else USAGE


def _overview(commands: dict[str, EntryPoint]) -> str:
    """What `jaxik --help` prints."""
    lines = ["usage: jaxik COMMAND [--help] [--debug] [options]", ""]
    for name in sorted(commands):
        try:
            text = inspect.getdoc(commands[name].load()) or ""
        except ImportError as error:
            text = f"not available: {error}"
        lines.append(f"  {_spoken(name):<16} {text.splitlines()[0] if text else ''}")
    return "\n".join([*lines, "", "jaxik COMMAND --help shows a command's options; jaxik demo is a good start."])


def _spoken(name: str) -> str:
    """A command as it is typed."""
    return name.replace("-", " ")


def _sentence(error: Exception) -> str:
    """What went wrong, on one line."""
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    text = " ".join(str(error).split())
    return text if isinstance(error, JaxikError | ValueError) else f"{type(error).__name__}: {text}"


def _hint(error: Exception) -> str:
    """Where to look, for errors that nobody foresaw."""
    return "" if isinstance(error, JaxikError | ValueError | OSError) else " (--debug shows where)"


def _complain(sentence: str) -> None:
    """One sentence on the error stream."""
    print(sentence, file=sys.stderr)
