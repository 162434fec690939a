"""The board without a board: a model of the firmware and of the servos on it, in plain Python."""

from hardware.simulation.board import BoardModel
from hardware.simulation.servos import Pulse

__all__ = ["BoardModel", "Pulse"]
