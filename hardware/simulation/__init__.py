"""Model of a board: the firmware and the servos on it, in plain Python."""

from hardware.simulation.board import MAX_PAYLOAD, BoardModel
from hardware.simulation.servos import ServoFrame

__all__ = ["MAX_PAYLOAD", "BoardModel", "ServoFrame"]
