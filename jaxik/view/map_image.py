"""The energy map in the panel: its picture is sent once, and its cursor is a line that moves over it."""

import base64
import io
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_WIDTH = "96%"  # of the panel; the rest is its scroll bar's


@dataclass(frozen=True)
class MapImage:
    """A picture, and where its axes lie in it; places are shares of width and height from the upper left corner.

    Attributes:
        png: The picture.
        aspect: Height over width.
        left: Place of the first time.
        right: Place of the last time.
        top: Upper end of the axes.
        bottom: Their lower end.
        first_s: First time [s].
        last_s: Last time [s].
    """

    png: bytes
    aspect: float
    left: float
    right: float
    top: float
    bottom: float
    first_s: float
    last_s: float

    @classmethod
    def of(cls, figure: "Figure") -> "MapImage":
        """The picture of a figure from :func:`jaxik.view.draw_energy_map`."""
        with io.BytesIO() as file:
            figure.savefig(file, format="png", dpi=110)
            png = file.getvalue()
        axes = figure.axes[0]
        box = axes.get_window_extent().transformed(figure.transFigure.inverted())
        width, height = figure.get_size_inches()
        return cls(png, height / width, box.x0, box.x1, 1 - box.y1, 1 - box.y0, *axes.get_xlim())

    def place(self, time: float) -> float:
        """Where a time [s] lies across the picture, kept within the axes."""
        share = (time - self.first_s) / (self.last_s - self.first_s)
        return self.left + min(max(share, 0.0), 1.0) * (self.right - self.left)

    def html(self) -> str:
        """The picture, as wide as the panel."""
        data = base64.b64encode(self.png).decode()
        return f"<img alt='energy map' style='display:block;width:{_WIDTH}' src='data:image/png;base64,{data}'>"

    def cursor_html(self, time: float) -> str:
        """A line over the picture, to stand right behind it: of no height itself, it reaches back up."""
        line = (
            f"position:absolute;left:{100 * self.place(time):.2f}%;top:{100 * self.top:.2f}%;"
            f"bottom:{100 * (1 - self.bottom):.2f}%;width:2px;margin-left:-1px;"
            "background:#d1495b;outline:1px solid white"
        )
        # A padding in percent counts the width: this box is as high as the picture above it.
        box = f"position:absolute;left:0;right:0;bottom:0;padding-top:{100 * self.aspect:.2f}%;pointer-events:none"
        outer = f"position:relative;height:0;width:{_WIDTH}"
        return f"<div style='{outer}'><div style='{box}'><div style='{line}'></div></div></div>"
