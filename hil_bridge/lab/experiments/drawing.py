"""Figures of the experiments: one look, and PNG bytes that repeat."""

import io
from typing import TYPE_CHECKING, Any

import numpy as np

from hil_bridge.show.charts.painter import GREY, STYLE
from hil_bridge.show.picture_files import drawing_library

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["COLOURS", "GREY", "MARKERS", "Sheet", "label"]

# Okabe-Ito colours: told apart with every common kind of colour blindness.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#8C6D31")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")

_STYLE: dict[Any, Any] = {**STYLE, "axes.titlesize": 10.5, "legend.frameon": False}


class Sheet:
    """A figure in the making: its axes, then its bytes. A context, for the style holds only inside."""

    def __init__(self, width: float, height: float, rows: int = 1, columns: int = 1, **how: Any) -> None:
        matplotlib = drawing_library()  # late: the command line imports this package
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        self._style = matplotlib.rc_context(_STYLE)
        self._size = (width, height)
        self._layout = (rows, columns)
        self._how = how
        self._figure_type, self._canvas_type = Figure, FigureCanvasAgg
        self.figure: Any
        self.axes: list[Axes]

    def __enter__(self) -> "Sheet":
        self._style.__enter__()
        self.figure = self._figure_type(figsize=self._size, dpi=100, layout="constrained")
        self._canvas = self._canvas_type(self.figure)
        self.axes = list(self.figure.subplots(*self._layout, squeeze=False, **self._how).flat)
        return self

    def __exit__(self, *reason: Any) -> None:
        self._style.__exit__(*reason)

    def png(self) -> bytes:
        """The picture. The same figure gives the same bytes with the same version of matplotlib."""
        from PIL import Image  # comes with matplotlib

        self._canvas.draw()  # type: ignore[no-untyped-call]
        drawn = np.asarray(self._canvas.buffer_rgba())  # type: ignore[no-untyped-call]
        pixels = Image.fromarray(drawn).convert("RGB")
        buffer = io.BytesIO()
        # A palette makes line drawings a third of the size; they are kept beside the documentation.
        pixels.quantize(128, dither=Image.Dither.NONE).save(buffer, "PNG", optimize=True)
        return buffer.getvalue()


def label(value: float) -> str:
    """A number for a legend: thousands apart."""
    return f"{value:,.0f}".replace(",", " ")
