"""Questions in the terminal while a board must hear from its host."""

import queue
import sys
import threading
from collections.abc import Callable

from hardware.board import Board

_KEEP_ALIVE_S = 0.1  # a board that hears nothing for two seconds releases the arm


def ask_in_terminal(board: Board) -> Callable[[str], str]:
    """Return a function that reads a line from the terminal; meanwhile it polls the board, which would stop else."""
    lines: queue.Queue[str] = queue.Queue()
    wanted = threading.Semaphore(0)

    def read() -> None:
        while wanted.acquire():
            line = sys.stdin.readline()
            lines.put(line or "quit")

    threading.Thread(target=read, daemon=True).start()

    def ask(prompt: str) -> str:
        print(prompt, end="", flush=True)
        wanted.release()
        while True:
            try:
                return lines.get(timeout=_KEEP_ALIVE_S)
            except queue.Empty:
                board.status()

    return ask
