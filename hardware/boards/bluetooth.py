"""Bluetooth LE through bleak for synchronous callers: an event loop in a thread, one request in flight."""

import asyncio
import contextlib
import threading
from collections.abc import Coroutine
from typing import Any

from hardware.errors import BoardError, LinkError

_COMMAND = "0000fff2-0000-1000-8000-00805f9b34fb"
_NOTIFY = "0000fff1-0000-1000-8000-00805f9b34fb"
_CONNECT_S = 20.0


class BluetoothExchange:
    """Requests to a robot and its answers, over Bluetooth LE.

    Args:
        address: Bluetooth address of the robot.

    Raises:
        BoardError: The package bleak is missing.
        LinkError: The robot is not found.
    """

    def __init__(self, address: str) -> None:
        try:
            from bleak import BleakClient  # pyright: ignore[reportMissingImports] - optional, and rarely installed
        except ImportError as error:
            raise BoardError('Bluetooth LE needs bleak: pip install bleak, or "jaxik[bluetooth]"') from error
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        self._answers: asyncio.Queue[bytes] = asyncio.Queue()
        self._client = BleakClient(address)
        try:
            self._wait(self._connect(), _CONNECT_S)
        except LinkError:
            self.close()
            raise

    def ask(self, frame: bytes, answer_s: float) -> bytes | None:
        """See :class:`hardware.boards.meccanoid.Exchange`."""
        return self._wait(self._ask(frame, answer_s), answer_s + 5.0)

    def close(self) -> None:
        """See :class:`hardware.boards.meccanoid.Exchange`."""
        if not self._thread.is_alive():
            return
        with contextlib.suppress(LinkError):
            self._wait(self._client.disconnect(), 5.0)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(5.0)
        self._loop.close()

    async def _connect(self) -> None:
        await self._client.connect()
        await self._client.start_notify(_NOTIFY, lambda _, data: self._answers.put_nowait(bytes(data)))

    async def _ask(self, frame: bytes, answer_s: float) -> bytes | None:
        while not self._answers.empty():
            self._answers.get_nowait()  # late answers to earlier requests
        await self._client.write_gatt_char(_COMMAND, frame, response=False)
        deadline = self._loop.time() + answer_s
        while (left := deadline - self._loop.time()) > 0:
            try:
                answer = await asyncio.wait_for(self._answers.get(), left)
            except TimeoutError:
                return None
            if answer[:1] == frame[:1]:
                return answer
        return None

    def _wait(self, work: Coroutine[Any, Any, Any], seconds: float) -> Any:
        """Run a coroutine in the loop and wait for its result; any exception from Bluetooth becomes a LinkError."""
        future = asyncio.run_coroutine_threadsafe(work, self._loop)
        try:
            return future.result(seconds)
        except Exception as error:  # bleak has exceptions of its own for every system
            future.cancel()
            raise LinkError(
                f"Bluetooth: {error or type(error).__name__}; is the robot on, near and not taken?"
            ) from error
