"""A matplotlib figure without its global state: pictures can be made anywhere, by any thread, without a screen."""

import io
from typing import TYPE_CHECKING

from jaxik.errors import MissingExtraError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

INK, PALE, WARM, COOL = "#22313f", "#b8c4ce", "#d1495b", "#2a6f97"


def new_figure(width: float, height: float) -> "Figure":
    """An empty figure [inch].

    Raises:
        MissingExtraError: matplotlib is absent.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingExtraError('pictures need matplotlib: pip install "jaxik[plots]"') from error

    class Picture(Figure):
        """Shows itself in a notebook, with no matplotlib setting there."""

        def _repr_png_(self) -> bytes:
            with io.BytesIO() as file:
                self.savefig(file, format="png", dpi=80)
                return file.getvalue()

    figure = Picture(figsize=(width, height), dpi=150, layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    return figure
