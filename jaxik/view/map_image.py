"""The energy map in the panel: the picture is sent once, and the cursor is a line that moves over it."""

import base64
import io
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_WIDTH = "96%"  # of the panel; the rest is left to the scroll bar


@dataclass(frozen=True)
class MapImage:
    """A picture and the position of its axes, as fractions of width and height from the upper left corner.

    Attributes:
        png: The picture in PNG format.
        aspect: Height divided by width.
        left: Horizontal position of the first time.
        right: Horizontal position of the last time.
        top: Upper edge of the axes.
        bottom: Lower edge of the axes.
        first: First time [s].
        last: Last time [s].
    """

    png: bytes
    aspect: float
    left: float
    right: float
    top: float
    bottom: float
    first: float
    last: float

    @classmethod
    def of(cls, figure: "Figure") -> "MapImage":
        """Return the picture of a figure by :func:`jaxik.view.draw_energy_map`."""
        with io.BytesIO() as file:
            figure.savefig(file, format="png", dpi=110)
            png = file.getvalue()
        axes = figure.axes[0]
        box = axes.get_window_extent().transformed(figure.transFigure.inverted())
        width, height = figure.get_size_inches()
        return cls(png, height / width, box.x0, box.x1, 1 - box.y1, 1 - box.y0, *axes.get_xlim())

    def place(self, time: float) -> float:
        """Return the horizontal position of a time [s], clipped to the axes."""
        fraction = (time - self.first) / (self.last - self.first)
        return self.left + min(max(fraction, 0.0), 1.0) * (self.right - self.left)

    def html(self) -> str:
        """Return the picture as HTML, as wide as the panel."""
        data = base64.b64encode(self.png).decode()
        return f"<img alt='energy map' style='display:block;width:{_WIDTH}' src='data:image/png;base64,{data}'>"

    def cursor_html(self, time: float) -> str:
        """Return a cursor line as HTML, to be placed after the picture: it has no height and extends upward."""
        line = (
            f"position:absolute;left:{100 * self.place(time):.2f}%;top:{100 * self.top:.2f}%;"
            f"bottom:{100 * (1 - self.bottom):.2f}%;width:2px;margin-left:-1px;"
            "background:#d1495b;outline:1px solid white"
        )
        # Padding in percent refers to the width, so this box is as high as the picture above it.
        box = f"position:absolute;left:0;right:0;bottom:0;padding-top:{100 * self.aspect:.2f}%;pointer-events:none"
        outer = f"position:relative;height:0;width:{_WIDTH}"
        return f"<div style='{outer}'><div style='{box}'><div style='{line}'></div></div></div>"
