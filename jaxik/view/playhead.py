"""Where a playback in the viewer stands: play, pause, scrub and speed, by whatever clock the caller has."""

from dataclasses import dataclass


@dataclass
class Playhead:
    """A place in a motion that moves on by itself while it plays, and begins anew at the end.

    Attributes:
        start_s: First time of the motion [s].
        end_s: Last time of the motion [s].
        at_s: Where it stands [s].
        speed: Seconds of motion per second.
        playing: Whether it moves on.
    """

    start_s: float
    end_s: float
    at_s: float
    speed: float = 1.0
    playing: bool = False

    def advance(self, elapsed_s: float) -> float:
        """Moves on by a time that has passed, if playing; returns where it stands [s]."""
        if self.playing:
            self.at_s += elapsed_s * self.speed
            if self.at_s > self.end_s:
                self.at_s = self.start_s  # the arm is drawn, not moved: jumping back harms nobody
        return self.at_s

    def seek(self, at_s: float) -> None:
        """Goes somewhere, kept within the motion; playing or not stays as it is."""
        self.at_s = min(max(at_s, self.start_s), self.end_s)
