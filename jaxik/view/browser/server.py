"""The viser server, and a drawing thread that skips outdated states."""

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
    """Start a server. It serves everything that a browser loads, so that no network is needed.

    Args:
        host: Address to listen on: ``"localhost"`` for this machine, ``"0.0.0.0"`` for the whole network.
        port: First port to try.

    Returns:
        The server; end it with :func:`close_server`.

    Raises:
        MissingExtraError: viser is not installed.
        OSError: There is no free port.
    """
    try:
        import viser
    except ImportError as error:
        raise MissingExtraError('the viewer needs viser: pip install "jaxik[view]"') from error
    with contextlib.redirect_stdout(io.StringIO()):  # it prints a greeting despite verbose=False
        server = viser.ViserServer(host=host, port=port, verbose=False, label="jaxik")
    server.gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
    server.gui.main_panel.dock_right()
    server.scene.set_up_direction("+z")
    return server


def close_server(server: "viser.ViserServer") -> None:
    """Stop a server and free its port.

    Args:
        server: Server by :func:`open_server`.
    """
    with contextlib.redirect_stdout(io.StringIO()):  # it prints a farewell
        server.stop()


class Latest(Generic[T]):
    """Pass the latest value to a drawing function, in a separate thread.

    A value that is replaced while the previous one is being drawn is skipped.

    Args:
        draw: Function of a value. Exceptions are printed, and drawing continues with the next value.
    """

    def __init__(self, draw: Callable[[T], None]) -> None:
        self._draw = draw
        self._value: T | None = None
        self._busy = self._closed = False
        self._change = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="jaxik-view", daemon=True)
        self._thread.start()

    def put(self, value: T) -> None:
        """Set the next value to draw, replacing one that is still waiting."""
        with self._change:
            self._value = value
            self._change.notify_all()

    def wait(self, timeout: float = 30.0) -> bool:
        """Wait up to ``timeout`` [s] until nothing is left to draw, and return True on success."""
        with self._change:
            return self._change.wait_for(lambda: self._value is None and not self._busy, timeout)

    def close(self) -> None:
        """Stop the thread after the current value."""
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
            except Exception:  # one bad frame must not end the viewer
                traceback.print_exc()
