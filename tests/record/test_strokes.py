"""Figures of a run of a program: per stroke, and relative to the target force of each sample."""

from collections.abc import Sequence

import pytest

from hil_bridge.errors import Cause, Reason
from hil_bridge.record import CycleRecord, Outcome, Recording, RunEnd, StepRecord
from hil_bridge.record.analysis.strokes import merit_of, strokes_of
from hil_bridge.record.analysis.summary import summarise, target_force_text
from hil_bridge.runs.outputs import figures
from tests.record.written_recordings import cycle_of

PERIOD = 0.1
END = RunEnd(Outcome.COMPLETED)


def cycles(
    phase: str,
    step: int,
    forces: Sequence[float],
    reference_n: float = 10.0,
    first: int = 0,
    touching: bool = True,
) -> list[CycleRecord]:
    """Return one cycle per force, every PERIOD."""
    return [
        cycle_of(
            cycle=k,
            phase=phase,
            started_at=k * PERIOD,
            status_at=k * PERIOD,
            sensor_at=k * PERIOD,
            controlled_at=k * PERIOD,
            sent_at=k * PERIOD,
            answered_at=k * PERIOD,
            sensor_sequence=k,
            force=force,
            force_reference=reference_n,
            in_contact=touching,
            step=step,
        )
        for k, force in enumerate(forces, first)
    ]


def row(*parts: list[CycleRecord]) -> tuple[CycleRecord, ...]:
    return tuple(cycle for part in parts for cycle in part)


TWO = row(
    cycles("approach", 1, [0.0]),
    cycles("track", 2, [9.5, *[10.0] * 49], first=1),
    cycles("retract", 3, [2.0], first=51),
    cycles("approach", 4, [0.0], first=52),
    cycles("track", 5, [1.0, 5.0, 19.0, *[20.5] * 50], 20.0, first=53),
    cycles("retract", 6, [0.0], first=106),
)


def test_each_contact_begins_a_stroke() -> None:
    strokes = strokes_of(Recording(TWO))
    assert [len(stroke) for stroke in strokes] == [50, 53]
    slow, quick = merit_of(strokes, None), merit_of(strokes[:1], None)
    assert (quick.rise_samples, slow.rise_samples) == (0, 2)
    assert slow.rise_s == pytest.approx(0.2)
    assert slow.overshoot_percent == pytest.approx(2.5)
    assert slow.steady_mean_error_n == pytest.approx(0.5)
    squares = 0.5**2 + 19.0**2 + 15.0**2 + 1.0 + 50 * 0.25
    assert slow.rms_error_n == pytest.approx((squares / 103) ** 0.5)


def test_stroke_without_rise_has_no_rise_time() -> None:
    weak = row(
        list(TWO[:51]), cycles("retract", 3, [2.0], first=51), cycles("track", 5, [1.0] * 50, first=52)
    )
    assert merit_of(strokes_of(Recording(weak)), None).rise_samples is None


def test_figures_without_stroke_raise() -> None:
    with pytest.raises(ValueError, match="need a stroke"):
        merit_of([], None)


def test_stroke_continues_while_lost_surface_is_searched() -> None:
    lost = row(
        cycles("track", 2, [10.0] * 3),
        cycles("track", 2, [0.0], first=3, touching=False),
        cycles("approach", 2, [0.0], first=4),
        cycles("track", 2, [10.0] * 3, first=5),
    )
    strokes = strokes_of(Recording(lost))
    assert [len(stroke) for stroke in strokes] == [7]
    assert merit_of(strokes, None).contact_losses == 1


def test_edge_found_by_seek_is_not_a_contact_loss() -> None:
    seek = row(
        cycles("track", 2, [10.0] * 3),
        cycles("track", 3, [10.0, 0.0], first=3),
        cycles("track", 3, [0.0], first=5, touching=False),
    )
    steps = (StepRecord(at=1.0, step=3, label="3 (seek)", began_at=0.0, word="seek"),)
    strokes = strokes_of(Recording(seek, steps=steps))
    assert [len(stroke) for stroke in strokes] == [3]
    assert merit_of(strokes, None).contact_losses == 0


def test_run_without_program_has_one_stroke() -> None:
    plain = row(
        cycles("track", 0, [10.0] * 3),
        cycles("approach", 0, [0.0], first=3),
        cycles("track", 0, [10.0] * 3, first=4),
    )
    assert [len(stroke) for stroke in strokes_of(Recording(plain))] == [6]


def test_varying_target_force_is_described() -> None:
    summary = summarise(Recording(TWO), END)
    assert summary.force_reference_n is None
    assert summary.force_references_n == (10.0, 20.0)
    assert target_force_text(summary) == "10 … 20 N"
    assert summary.force_mean_steady_n == pytest.approx(20.5)
    lines = figures(summary)
    assert " at 10 … 20 N with" in lines[0]
    assert "  rise to 90 %   2 samples, 0.20 s in the slowest of 2 strokes" in lines


def test_force_profile_has_no_mean_force() -> None:
    ramp = [one for k in range(60) for one in cycles("track", 1, [5.0 + k / 10], 5.0 + k / 10, first=k)]
    summary = summarise(Recording(tuple(ramp)), END)
    assert summary.force_mean_steady_n is None
    assert summary.figures["steady_peak_to_peak_n"] == 0.0
    assert "  steady error   +0.00 N mean, 0.00 N peak to peak" in figures(summary)


def test_retract_step_is_not_the_stopping_sample() -> None:
    stopped = RunEnd(Outcome.STOPPED, Reason(Cause.TOUCH, "the tool touches something in free space"))
    loud = row(cycles("track", 2, [10.0] * 50), cycles("retract", 3, [12.0], first=50))
    assert summarise(Recording(loud), stopped).figures["largest_force_n"] == 10.0
    same = row(cycles("track", 2, [10.0] * 50), cycles("retract", 2, [12.0], first=50))
    assert summarise(Recording(same), stopped).figures["largest_force_n"] == 12.0
