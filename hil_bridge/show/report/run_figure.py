"""Matplotlib figure that a notebook displays. Import it lazily: matplotlib takes almost a second."""

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from hil_bridge.show.picture_files import save_figure


class RunFigure(Figure):
    """Figure drawn without a window, and displayed as PNG."""

    def __init__(self, size_inch: tuple[float, float], dpi: float) -> None:
        super().__init__(figsize=size_inch, dpi=dpi)
        self.set_layout_engine("constrained", h_pad=0.05, w_pad=0.08)
        FigureCanvasAgg(self)

    def _repr_png_(self) -> bytes:
        return save_figure(self, "png")
