"""A viser server, and the thread that draws: always the latest state, never a queue of old ones."""

import contextlib
import io
import threading
import traceback
from collections.abc import Callable
from typing import TYPE_CHECKING, Generic, TypeVar

from jaxik.errors import MissingExtraError

if TYPE_CHECKING:
    import viser

T = TypeVar("T")


def open_server(host: str = "localhost", port: int = 8080) -> "viser.ViserServer":
    """A server with the program's looks; everything a browser loads comes from it, so no network is needed.

    Args:
        host: Where to listen: ``"localhost"`` for this machine, ``"0.0.0.0"`` for the whole network.
        port: Where to begin looking for a free one.

    Raises:
        MissingExtraError: viser is absent; with the pip line.
        OSError: No free port.
    """
    try:
        import viser
    except ImportError as error:
        raise MissingExtraError('the viewer needs viser: pip install "jaxik[view]"') from error
    with contextlib.redirect_stdout(io.StringIO()):  # it greets on its own, whatever verbose says
        server = viser.ViserServer(host=host, port=port, verbose=False, label="jaxik")
    server.gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
    server.gui.main_panel.dock_right()
    server.scene.set_up_direction("+z")
    return server


def close_server(server: "viser.ViserServer") -> None:
    """Ends a server and frees its port.

    Args:
        server: From :func:`open_server`.
    """
    with contextlib.redirect_stdout(io.StringIO()):  # it takes its leave on its own, too
        server.stop()


class Latest(Generic[T]):
    """Hands the latest value to a function, in a thread of its own.

    Events come as fast as a hand moves; a value that is overtaken while the one before is drawn is never drawn.

    Args:
        draw: What to do with a value. An exception is printed and the next value tried.
    """

    def __init__(self, draw: Callable[[T], None]) -> None:
        self._draw = draw
        self._value: T | None = None
        self._busy = self._closed = False
        self._change = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="jaxik-view", daemon=True)
        self._thread.start()

    def put(self, value: T) -> None:
        """Leaves a value to be drawn, in place of one still waiting."""
        with self._change:
            self._value = value
            self._change.notify_all()

    def settle(self, timeout_s: float = 30.0) -> bool:
        """Waits until nothing is left to draw; whether that came about in time."""
        with self._change:
            return self._change.wait_for(lambda: self._value is None and not self._busy, timeout_s)

    def close(self) -> None:
        """Ends the thread once the value at hand is drawn."""
        with self._change:
            self._closed = True
            self._change.notify_all()
        self._thread.join(5.0)

    def _run(self) -> None:
        while True:
            with self._change:
                self._busy = False
                self._change.notify_all()
                self._change.wait_for(lambda: self._value is not None or self._closed)
                if self._value is None:
                    return
                value, self._value, self._busy = self._value, None, True
            try:
                self._draw(value)
            except Exception:  # the viewer outlives one bad frame, and says what it was
                traceback.print_exc()
