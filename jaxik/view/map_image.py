"""The energy map as an image whose cursor moves: drawn once, the cursor laid over a copy."""

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class MapImage:
    """An energy map's picture and where time lies on it.

    Args:
        figure: From :func:`jaxik.view.draw_energy_map`.
    """

    def __init__(self, figure: "Figure") -> None:
        figure.canvas.draw()
        self._pixels = np.asarray(figure.canvas.buffer_rgba())[..., :3].copy()  # pyright: ignore
        axes = figure.axes[0]
        height = self._pixels.shape[0]
        box = axes.get_window_extent()
        self._top, self._bottom = round(height - box.y1), round(height - box.y0)
        self._first, self._last = axes.get_xlim()
        self._left, self._right = box.x0, box.x1

    def column(self, time_s: float) -> int:
        """Pixel column of a time [s], kept within the axes."""
        share = (time_s - self._first) / (self._last - self._first)
        return round(self._left + min(max(share, 0.0), 1.0) * (self._right - self._left))

    def at(self, time_s: float) -> np.ndarray:
        """The picture with its cursor at a time [s], ``(height, width, 3)`` uint8."""
        image, middle = self._pixels.copy(), self.column(time_s)
        rows = slice(self._top, self._bottom)
        image[rows, max(middle - 2, 0) : middle + 3] = 255
        image[rows, max(middle - 1, 0) : middle + 2] = (209, 73, 91)
        return image
