"""Bode charts of a linear force loop, with the stability margins."""

import math

import numpy as np

from hil_bridge.control.analysis.stability import loop_phase_deg, loop_response
from hil_bridge.show.charts.sources import round_values
from hil_bridge.show.pages import Axis, Chart, Charts, Limit, Mark, Series
from hil_bridge.show.report.stability import Analysis, LinearLoop

_POINTS = 300
_BELOW = 30.0
"""Ratio of the lower crossover to the lowest frequency of the charts."""
_LOWEST_PHASE_DEG = -450.0
_AXIS = "frequency"


def loop_charts(analysis: Analysis, loop: LinearLoop) -> Charts:
    """Return the gain and phase charts, on a frequency axis."""
    plant, loop_margins = analysis.plant, loop.margins
    top = math.pi / plant.period
    crossings = [
        w for w in (loop_margins.gain_crossover_rad_s, loop_margins.phase_crossover_rad_s) if math.isfinite(w)
    ]
    omega = np.geomspace(min([*crossings, top]) / _BELOW, top, _POINTS)
    gain = np.abs(loop_response(analysis.stiffness, loop.response, plant, omega * plant.period))
    phase = loop_phase_deg(analysis.stiffness, loop.response, plant, omega)
    phase = np.where(phase < _LOWEST_PHASE_DEG, np.nan, phase)
    return Charts(
        axes={_AXIS: Axis("frequency", "rad/s", log=True)},
        charts=[
            Chart(
                "gain",
                "Loop gain",
                "",
                [Series("loop", "gain", "gain")],
                limits=[Limit(1.0, "gain", "target")],
                axis=_AXIS,
                log=True,
            ),
            Chart(
                "phase",
                "Loop phase",
                "°",
                [Series("loop", "phase", "phase", "6")],
                limits=[Limit(-180.0, "inverted", "target", shown=True)],
                axis=_AXIS,
            ),
        ],
        sources={
            "loop": {"x": round_values(omega), "gain": round_values(gain), "phase": round_values(phase)}
        },
        marks=list(_marks(loop)),
    )


def _marks(loop: LinearLoop) -> list[Mark]:
    """Return marks at the crossovers, labelled with the margins."""
    loop_margins, marks = loop.margins, []
    if math.isfinite(at := loop_margins.phase_crossover_rad_s) and math.isfinite(loop_margins.gain_margin):
        marks.append(Mark(at, f"gain margin {loop_margins.gain_margin:.2f}", "note", _AXIS))
    turned = (
        loop_margins.phase_margin_deg > 0.0 and not loop_margins.stable
    )  # beyond one turn of phase, there is no margin to show
    if math.isfinite(at := loop_margins.gain_crossover_rad_s) and not turned:
        margin = f"{loop_margins.phase_margin_deg:.0f}°".replace("-", "−")
        marks.append(Mark(at, f"phase margin {margin}", "note", _AXIS))
    return marks
