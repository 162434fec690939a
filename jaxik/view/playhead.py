"""Playback position in the viewer: play, pause, seek and speed, independent of any clock."""

from dataclasses import dataclass


@dataclass
class Playhead:
    """Position in a motion that advances while playing and restarts at the end.

    Attributes:
        start: First time of the motion [s].
        end: Last time of the motion [s].
        time: Current time [s].
        speed: Seconds of motion per second.
        playing: True while it advances.
    """

    start: float
    end: float
    time: float
    speed: float = 1.0
    playing: bool = False

    def advance(self, elapsed: float) -> float:
        """Advance by an elapsed time [s] if playing, and return the current time [s]."""
        if self.playing:
            self.time += elapsed * self.speed
            if self.time > self.end:
                self.time = self.start  # the arm is only drawn, so it may jump back
        return self.time

    def seek(self, time: float) -> None:
        """Go to a time [s], clipped to the motion."""
        self.time = min(max(time, self.start), self.end)
