"""Gain and phase of a linear force loop over frequency, the margins marked."""

import io
import math

import numpy as np

from hil_bridge.control.analysis.stability import loop_phase_deg, loop_response
from hil_bridge.report.plots import STYLE
from hil_bridge.report.stability import Analysis, LinearLoop

LOOP_SIZE_PX = (900, 520)
_DPI = 100
_POINTS = 600
_BELOW = 30.0
"""Factor below the lower crossover at which the figure begins."""
_LOWEST_PHASE_DEG = -450.0
_GAIN, _PHASE, _MARGIN = "#0072B2", "#CC79A7", "#D55E00"


def draw_loop(analysis: Analysis, loop: LinearLoop) -> bytes:
    """The figure as PNG."""
    import matplotlib  # late, as for the picture
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    plant, found = analysis.plant, loop.margins
    top = math.pi / plant.period
    crossings = [w for w in (found.gain_crossover_rad_s, found.phase_crossover_rad_s) if math.isfinite(w)]
    omega = np.geomspace(min([*crossings, top]) / _BELOW, top, _POINTS)
    gain = np.abs(loop_response(analysis.stiffness, loop.response, plant, omega * plant.period))
    phase = loop_phase_deg(analysis.stiffness, loop.response, plant, omega)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(LOOP_SIZE_PX[0] / _DPI, LOOP_SIZE_PX[1] / _DPI), dpi=_DPI)
        figure.set_layout_engine("constrained", h_pad=0.06, w_pad=0.06)
        canvas = FigureCanvasAgg(figure)
        upper, lower = figure.subplots(2, 1, sharex=True)
        upper.loglog(omega, gain, color=_GAIN, lw=1.6)
        upper.axhline(1.0, color="#606060", lw=0.9, ls="--")
        upper.set_ylabel("loop gain")
        upper.set_ylim(bottom=min(1.0, float(gain.min())) / 3.0)
        lower.semilogx(omega, phase, color=_PHASE, lw=1.6)
        lower.axhline(-180.0, color="#606060", lw=0.9, ls="--")
        lower.set_ylabel("phase, °")
        lower.set_ylim(max(_LOWEST_PHASE_DEG, float(phase.min()) - 20.0), min(0.0, float(phase.max()) + 20.0))
        lower.set_yticks([tick for tick in range(-450, 1, 90) if lower.get_ylim()[0] <= tick <= 0])
        lower.set_xlabel("frequency, rad/s")
        lower.set_xlim(omega[0], omega[-1] * 1.06)
        label = {"xytext": (-7, 0), "textcoords": "offset points", "color": _MARGIN, "ha": "right"}
        if math.isfinite(at := found.phase_crossover_rad_s) and math.isfinite(found.gain_margin):
            left = 1.0 / found.gain_margin
            upper.plot([at, at], [left, 1.0], color=_MARGIN, lw=2.4, marker="_", ms=9)
            text = f"gain margin {found.gain_margin:.2f}"
            upper.annotate(text, (at, min(left, 1.0)), va="top", **label)
            lower.axvline(at, color="#909090", lw=0.8, ls=":")
        turned = found.phase_margin_deg > 0.0 and not found.stable  # more than a turn: no margin to be shown
        if math.isfinite(at := found.gain_crossover_rad_s) and not turned:
            reached = -180.0 + found.phase_margin_deg
            lower.plot([at, at], [-180.0, reached], color=_MARGIN, lw=2.4, marker="_", ms=9)
            text = f"phase margin {found.phase_margin_deg:.0f}°".replace("-", "−")
            lower.annotate(text, (at, (reached - 180.0) / 2), va="center", **label)
            upper.axvline(at, color="#909090", lw=0.8, ls=":")
        buffer = io.BytesIO()
        canvas.print_png(buffer, metadata={"Software": None})  # type: ignore[no-untyped-call]
    return buffer.getvalue()
