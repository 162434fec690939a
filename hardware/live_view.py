"""The arm in the browser as it plays, drawn by a process of its own, which takes no time from the one that sends."""

import contextlib
import json
import os
import subprocess
import sys
from types import TracebackType

import numpy as np

from hardware.report import LogRow
from jaxik.arm import ArmModel
from jaxik.cli import ARMS, InputError, find_arm
from jaxik.trajectories import Trajectory

_LONGEST_LINE = 4096  # bytes that a pipe takes as a whole or not at all


class LiveView:
    """A page in the browser that shows the rows of a playback's log. To be used in a ``with`` statement.

    Args:
        trajectory: The motion, whose joints are shown.
        arm: Preset or file of the arm; None for the trajectory's own, or every preset whose joints it moves.
        base: Base link or body in the file of the arm, as for the commands.
        tip: Tip link, body or site in the file of the arm.

    Attributes:
        address: Address of the page.

    Raises:
        InputError: The arm is not known.
        MissingExtraError: viser is not installed.
    """

    def __init__(
        self, trajectory: Trajectory, arm: str | None = None, base: str | None = None, tip: str | None = None
    ) -> None:
        named = [(arm, base, tip)] if arm is not None else [(name, base, tip) for name in _arms(trajectory)]
        self._places = [_places(find_arm(*words), words[0], trajectory) for words in named]
        self._process = subprocess.Popen(
            [sys.executable, "-m", __name__, json.dumps(named)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,  # Ctrl-C is not for it: it ends with its input
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self.address = self._process.stdout.readline().decode().strip()
        if not self.address:
            self.close()
            raise InputError('the browser view did not start; it needs viser: pip install "jaxik[view]"')
        self._pipe = self._process.stdin.fileno()
        if os.name == "posix":
            os.set_blocking(self._pipe, False)

    def show(self, row: LogRow) -> None:
        """Show a row: measured joint angles, or commanded ones of servos without read-back."""
        q = np.where(np.isnan(row.measured), row.commanded, row.measured)
        postures = [np.round(q[places], 5).tolist() for places in self._places]
        line = json.dumps([f"{row.phase}, {row.time:.1f} s", postures]).encode() + b"\n"
        if len(line) > _LONGEST_LINE:
            return
        with contextlib.suppress(OSError):  # it is busy, or has been ended: the arm plays on
            os.write(self._pipe, line)

    def close(self) -> None:
        """End the page; a second call does nothing."""
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                stream.close()
        try:
            self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def __enter__(self) -> "LiveView":
        """Return the view itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close."""
        self.close()


def _arms(trajectory: Trajectory) -> list[str]:
    """Return the presets that a trajectory moves."""
    models = {name: make() for name, make in ARMS.items()}
    fitting = {name: model for name, model in models.items() if set(model.joint_names) <= set(trajectory.joint_names)}
    own = [name for name, model in fitting.items() if model.name == trajectory.arm_name]
    chosen = own or list(fitting)
    if not chosen:
        raise InputError(
            f"no preset has joints that this trajectory moves ({', '.join(trajectory.joint_names)}); pass the model "
            "file of the arm to show with --arm"
        )
    taken = set().union(*(models[name].joint_names for name in chosen))
    alone = sum(len(models[name].joint_names) for name in chosen) == len(taken)
    return chosen if alone else chosen[:1]


def _places(model: ArmModel, name: str, trajectory: Trajectory) -> list[int]:
    """Return the places of an arm's joints in a trajectory."""
    names = model.joint_names
    missing = [joint for joint in names if joint not in trajectory.joint_names]
    if missing:
        raise InputError(f"the trajectory does not move {', '.join(missing)} of {name}; pass another arm with --arm")
    return [trajectory.joint_names.index(joint) for joint in names]


def _serve(arms: list[tuple[str, str | None, str | None]]) -> None:
    """Show what comes by the standard input until it ends."""
    from jaxik.view.browser import PosturePage, close_server, open_server

    server = open_server()
    page = PosturePage(server, [find_arm(*words) for words in arms])
    print(f"http://localhost:{server.get_port()}", flush=True)
    for line in sys.stdin:
        state, postures = json.loads(line)
        page.show([np.array(q) for q in postures], state)
    page.close()
    close_server(server)


if __name__ == "__main__":
    _serve(json.loads(sys.argv[1]))
