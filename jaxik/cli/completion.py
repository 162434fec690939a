"""``jaxik completion``: a script by which the shell completes commands and options."""

import io
from contextlib import redirect_stdout
from importlib.metadata import entry_points
from pathlib import Path
from typing import Annotated, Literal

import tyro

from jaxik.cli.console import Screen

_PLACES = {
    "bash": "~/.local/share/bash-completion/completions/jaxik",
    "zsh": "~/.zfunc/_jaxik, in a folder of $fpath",
    "fish": "~/.config/fish/completions/jaxik.fish",
}


def completion(
    shell: Annotated[Literal["bash", "zsh", "fish"], tyro.conf.Positional] = "bash",
    out: Path | None = None,
    json: bool = False,
) -> int:
    """Print a script by which the shell completes commands and options, or write it to a file.

    Args:
        shell: The shell. It reads the script from ~/.local/share/bash-completion/completions/jaxik (bash), _jaxik in a
            folder of $fpath (zsh), or ~/.config/fish/completions/jaxik.fish (fish).
        out: File to write; its folder is made.
        json: Print one JSON document instead of the script.

    Returns:
        0.
    """
    screen, script = Screen(json), completion_script(shell)
    if out is not None:
        out = out.expanduser()
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(script, encoding="utf-8")
        screen.say(f"saved {out}; a new {shell} reads it from {_PLACES[shell]}")
    elif not json:
        print(script, end="")
    screen.result(
        {"shell": shell, "place": _PLACES[shell], "file": None if out is None else str(out), "script": script}
    )
    return 0


def completion_script(shell: str) -> str:
    """Return the script for a shell, with the commands of every installed package.

    Args:
        shell: bash, zsh or fish.
    """
    from tyro.extras import subcommand_cli_from_dict

    commands = {}
    for point in sorted(entry_points(group="jaxik.commands"), key=lambda point: point.name):
        try:
            commands[point.name.replace("-", " ")] = point.load()
        except ImportError:  # an extra is missing, and so is its command
            continue
    text = io.StringIO()
    try:
        with redirect_stdout(text):
            subcommand_cli_from_dict(commands, prog="jaxik", args=["--tyro-print-completion", shell])
    except SystemExit:  # tyro has printed the script
        pass
    return text.getvalue().rstrip("\n") + "\n"
