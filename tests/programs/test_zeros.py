"""Zeros between strokes with a drifting sensor: they hide no force from the guard."""

from collections.abc import Callable
from typing import Any

import pytest

from hil_bridge.errors import Cause

pytestmark = pytest.mark.sweep

Trial = Any
Play = Callable[..., Trial]
LINE = {"kind": "line", "length_mm": 10}
STROKE = [
    {"do": "approach"},
    {"do": "track", "path": LINE, "speed_mm_s": 5.0, "limits": {"force_limit_n": 16.0}},
    {"do": "retract"},
]
ZERO = {"do": "zero", "settle_ms": 500.0, "for_ms": 300.0}
CELL = {
    "cell": {"start_position_mm": (900.0, -100.0, 591.0)},
    "task": {"retract_mm": 4.0, "retract_speed_mm_s": 11.0},
}
LESS, MORE = -0.12, 0.12
"""Drifts of Fz, N/s. Fz is negative while the tool presses, so the first one makes the force read too high."""


def drifting(per_s: float) -> Callable[[Trial, Any], None]:
    def meddle(run: Trial, record: Any) -> None:
        if not run.cell.faults:
            run.inject("signal", "drift", axis="fz", per_s=per_s, for_s=600.0)

    return meddle


def true_force(run: Trial, number: int) -> float:
    """Mean true force along the approach over the second half of a step, N."""
    records = run.of(number)
    late = (run.times > records[len(records) // 2].started_at) & (run.times < records[-1].started_at)
    return float(run.forces[late, 2].mean())


@pytest.mark.parametrize(("robot", "per_s"), [("s3", LESS), ("s3", MORE), ("egm", LESS)])
def test_zero_between_strokes_removes_drift(play: Play, robot: str, per_s: float) -> None:
    with_zeros = play(robot, [*STROKE, ZERO, *STROKE, ZERO, *STROKE], CELL, meddle=drifting(per_s))
    assert with_zeros.result.outcome == "completed"
    assert with_zeros.result.left.startswith("retracted, ")
    assert true_force(with_zeros, 10) == pytest.approx(10.0, abs=1.0)
    assert with_zeros.differs() == []


def test_drift_without_zeros_is_reported_at_end(play: Play) -> None:
    without = play("s3", [*STROKE, *STROKE, *STROKE], CELL, meddle=drifting(LESS))
    assert true_force(without, 8) < 9.3
    assert without.stopped
    assert "or the sensor's zero has changed" in without.cause
    assert without.result.cause is Cause.LEFT_PRESSING


def test_zero_in_contact_is_refused(play: Play) -> None:
    """Something presses on the stationary tool, because the sensor jumps by 3 N."""

    def jump(run: Trial, record: Any) -> None:
        if record.phase == "zero" and not run.cell.faults:
            run.inject("signal", "offset", axis="fz", amount=-3.0)

    run = play("s3", [*STROKE, ZERO, *STROKE], CELL, meddle=jump)
    assert run.stopped
    assert "would be used as the zero, allowed: at most 2 N" in run.cause
    assert run.result.cause is Cause.DRIFT
    assert run.cause.endswith("in step 4 (zero)")
    assert run.last == 0.0


@pytest.mark.parametrize(("robot", "ramp_ms"), [("s3", 300.0), ("egm", 30.0)])
def test_many_zeros_hide_no_force(play: Play, robot: str, ramp_ms: float) -> None:
    """Each zero removes less than 2 N, and all together remove 6 N or more. Then the surface rises, and the tool
    presses beyond the limit while the sensor reports less.
    """

    def meddle(run: Trial, record: Any) -> None:
        if not run.cell.faults:
            run.inject("signal", "drift", axis="fz", per_s=1.0, for_s=600.0)
        if record.step == 10 and record.travel_commanded > 3e-3 and len(run.cell.faults) == 1:
            run.inject("surface", "step", mm=3.0, ramp_ms=ramp_ms)

    run = play(robot, [*[ZERO] * 8, *STROKE], CELL, meddle=meddle)
    assert "is beyond 16 N, in step 10 (track)" in run.cause
    stop = next(record for record in run.cycles if record.verdict == "stop")
    assert abs(stop.sample.force) < stop.sample.peak_force < 16.0 < stop.force
    assert run.largest < 16.0 + 15.0, "the complete rise of 3 mm at 5 kN/m"
