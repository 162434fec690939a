"""Matplotlib figures without global state, so that any thread can draw without a display."""

import io
from typing import TYPE_CHECKING

from jaxik.errors import MissingExtraError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

INK, PALE, WARM, COOL = "#22313f", "#b8c4ce", "#d1495b", "#2a6f97"


def new_figure(width: float, height: float) -> "Figure":
    """Return an empty figure.

    Args:
        width: Width [inch].
        height: Height [inch].

    Returns:
        The figure, which displays itself in a notebook.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingExtraError('pictures need matplotlib: pip install "jaxik[plots]"') from error

    class Picture(Figure):
        """A figure that a notebook displays without any matplotlib settings."""

        def _repr_png_(self) -> bytes:
            with io.BytesIO() as file:
                self.savefig(file, format="png", dpi=80)
                return file.getvalue()

    figure = Picture(figsize=(width, height), dpi=150, layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    return figure
