"""Response figures of recordings: where they begin, and from which records they come."""

import json
import math
from collections.abc import Callable

import pytest

from hil_bridge.errors.event_kinds import EventKind
from hil_bridge.record import CycleRecord, EventRecord, Outcome, Recording, RunEnd
from hil_bridge.record.analysis.response import response_figures
from hil_bridge.record.analysis.stream import stream_of
from hil_bridge.record.analysis.strokes import strokes_of
from hil_bridge.record.analysis.summary import summarise
from hil_bridge.record.records import FaultNote, TruthRecord
from hil_bridge.show.report.figures import response_rows
from protocol.faults import FaultStage
from tests.record.written_recordings import cycle_of
from tests.recordings import Recordings

PERIOD = 0.125
"""Seconds between cycles, which is exact."""
TOUCH = 16
"""Number of the first cycle in contact."""
SENSOR = {"quaternion": [1, 0, 0, 0], "mounting_deg": 0, "flip_fx_mx": False}
CONFIG = {"config": json.dumps({"frame": {"approach": [0, 0, -1]}, "sensor": SENSOR})}


def pressed(
    force: Callable[[float], float], seconds: float, target: Callable[[float], float] = lambda at: 10.0
) -> tuple[CycleRecord, ...]:
    """Return cycles that approach at 4 mm/s, touch at 2 s, and track from the next cycle on.

    Force and target are functions of the time since the touch.
    """
    cycles = []
    for k in range(TOUCH + round(seconds / PERIOD) + 1):
        at, since = k * PERIOD, (k - TOUCH) * PERIOD
        cycles.append(
            cycle_of(
                cycle=k,
                phase="track" if k > TOUCH else "approach",
                **dict.fromkeys(
                    ("started_at", "status_at", "sensor_at", "controlled_at", "sent_at", "answered_at"), at
                ),
                sensor_sequence=k,
                force=force(since) if since >= 0 else 0.0,
                force_reference=target(since) if k > TOUCH else math.nan,
                in_contact=k > TOUCH,
                depth=4e-3 * at if since < 0 else 0.0,
            )
        )
    return tuple(cycles)


def figures_of(recording: Recording) -> dict[str, float | None]:
    return response_figures(recording, strokes_of(recording))


def test_touch_is_measured_from_first_force() -> None:
    figures = figures_of(Recording(pressed(lambda since: 18.0 if since < 1.0 else 10.5, 8.0)))
    assert figures["touch_speed_mm_s"] == pytest.approx(4.0)
    assert figures["touch_peak_n"] == 18.0
    assert figures["settle_s"] == 1.0
    # 8 N for 7 periods, then down to 0.5 N over one and 0.5 N for the rest of 3 s
    assert figures["touch_impulse_ns"] == pytest.approx(PERIOD * (7 * 8.0 + (8.0 + 0.5) / 2 + 16 * 0.5))
    assert figures["track_error_mean_n"] == 0.5
    assert figures["disturbance_peak_n"] is None


def test_short_contact_has_no_touch_figures() -> None:
    figures = figures_of(Recording(pressed(lambda since: 10.0, 3.0)))
    assert figures["settle_s"] is None
    assert figures["touch_speed_mm_s"] == pytest.approx(4.0)


def test_recording_that_begins_in_contact_has_no_speed() -> None:
    (first, *_), cycles = pressed(lambda since: 10.0, 0.0), pressed(lambda since: 10.0, 8.0)[TOUCH + 1 :]
    figures = figures_of(Recording(cycles))
    assert figures["touch_speed_mm_s"] is None
    assert figures["settle_s"] == 0.0
    assert figures_of(Recording((first, *cycles)))["touch_speed_mm_s"] is None
    assert figures_of(Recording(cycles[:1]))["track_error_mean_n"] is None


def test_fault_at_end_of_tracking_has_no_figures() -> None:
    cycles = pressed(lambda since: 10.0, 8.0)
    begun = fault(8.0 - PERIOD / 4, FaultStage.BEGINS)
    ended = fault(8.0 - PERIOD / 8, FaultStage.ENDS)
    assert figures_of(Recording(cycles, events=(begun, ended)))["disturbance_peak_n"] is None


def test_recording_without_stroke_has_no_response() -> None:
    approach = pressed(lambda since: 0.0, 0.0)
    assert figures_of(Recording(approach)) == {}
    nothing = figures_of(Recording(pressed(lambda since: 0.0, 8.0)))
    assert set(nothing.values()) == {None}
    untargeted = figures_of(Recording(pressed(lambda since: 10.0, 8.0, lambda since: math.nan)))
    assert set(untargeted.values()) == {None}


def fault(at: float, stage: FaultStage, name: str = "step", **values: float) -> EventRecord:
    """Return an event of the surface at a time after the touch."""
    note = FaultNote("surface", name, stage, values)
    return EventRecord(TOUCH * PERIOD + at, EventKind.FAULT, name, fault=note)


def test_disturbance_has_peak_settling_and_error() -> None:
    cycles = pressed(lambda since: 10.0 if since < 5.0 else 13.0 if since < 6.0 else 10.5, 12.0)
    events = (fault(5.0, FaultStage.BEGINS), fault(9.0, FaultStage.ENDS))
    figures = figures_of(Recording(cycles, events=events))
    assert figures["disturbance_peak_n"] == 3.0
    assert figures["disturbance_settle_s"] == 1.0
    assert figures["disturbance_error_n"] == 0.5
    assert figures["disturbance_n_mm"] is None
    lasting = figures_of(Recording(cycles, events=events[:1]))
    assert lasting["disturbance_error_n"] == 0.5
    early = figures_of(Recording(cycles, events=(fault(-1.0, FaultStage.BEGINS),)))
    assert early["disturbance_peak_n"] is None


def test_oscillating_surface_has_force_per_motion() -> None:
    cycles = pressed(lambda since: 10.0 + 1.5 * math.sin(math.pi * since), 14.0)
    events = (
        fault(4.0, FaultStage.BEGINS, "swings", mm=0.5, period_s=2.0),
        fault(12.0, FaultStage.ENDS, "swings"),
    )
    assert figures_of(Recording(cycles, events=events))["disturbance_n_mm"] == pytest.approx(3.0, rel=0.01)
    short = (events[0], fault(9.0, FaultStage.ENDS, "swings"))
    assert figures_of(Recording(cycles, events=short))["disturbance_n_mm"] is None


def test_drift_is_measured_and_true() -> None:
    cycles = pressed(lambda since: 10.0 + since / 60, 64.0)
    truths = tuple(
        TruthRecord(k, cycle.started_at, 0.0, 0.0, (0.0,) * 3, (0.0, 0.0, 10.0 - k * PERIOD / 30), (0.0,) * 6)
        for k, cycle in enumerate(cycles)
    )
    figures = figures_of(Recording(cycles, metadata=CONFIG, truths=truths))
    assert figures["drift_n_min"] == pytest.approx(1.0)
    assert figures["drift_true_n_min"] == pytest.approx(-2.0)
    assert figures_of(Recording(cycles[:-64]))["drift_n_min"] is None


def test_ramp_and_sine_come_from_target() -> None:
    ramp = pressed(lambda since: 9.0 + since, 8.0, lambda since: 10.0 + since)
    assert figures_of(Recording(ramp))["ramp_lag_s"] == pytest.approx(1.0)
    sine = pressed(
        lambda since: 10.0 + math.sin(math.pi * since / 2),
        24.0,
        lambda since: 10.0 + 2 * math.sin(math.pi * since / 2),
    )
    figures = figures_of(Recording(sine))
    assert figures["sine_gain"] == pytest.approx(0.5)
    assert figures["sine_phase_deg"] == pytest.approx(0.0, abs=1e-6)


def test_peak_between_cycles_is_in_frames(recordings: Recordings) -> None:
    settings = {
        "run": {"duration_s": 5.0},
        "task": {"approach_speed_mm_s": 10.0, "expected_stiffness_n_m": 1000.0, "speed_mm_s": 0.0},
        "cell": {"start_position_mm": [900.0, -100.0, 591.5], "surface": {"stiffness_n_m": 20000.0}},
    }
    recording = recordings(settings)
    stream = stream_of(recording)
    assert stream is not None
    figures = figures_of(recording)
    peak = figures["touch_peak_n"]
    assert peak is not None
    assert peak > max(cycle.force for cycle in recording.cycles)
    rows = {row.label: row.value for row in response_rows(summarise(recording, RunEnd(Outcome.COMPLETED)))}
    assert rows["peak of the touch"] == f"{peak:.1f} N"
    assert "disturbance peak" not in rows


def test_sine_of_hold_is_target_of_every_cycle(recordings: Recordings) -> None:
    hold = {"do": "hold", "for_s": 18.0, "force_n": 10.0, "sine_n": 2.0, "sine_hz": 0.25}
    steps = [{"do": "approach", "at_most_mm": 4.0}, hold, {"do": "retract", "back_mm": 2.0}]
    recording = recordings({"task": {"step": steps}, "cell": {"start_position_mm": [900.0, -100.0, 591.5]}})
    (step,) = (record for record in recording.steps if record.word == "hold")
    sines = [cycle for cycle in recording.cycles if cycle.phase == "track" and cycle.step == step.step]
    assert len(sines) > 90
    for cycle in sines:
        target = 10.0 + 2.0 * math.sin(math.tau * 0.25 * (cycle.sample.now - step.began_at))
        assert cycle.force_reference == pytest.approx(target, abs=1e-9)
    gain, phase = (figures_of(recording)[key] for key in ("sine_gain", "sine_phase_deg"))
    assert gain is not None
    assert phase is not None
    assert 0.5 < gain < 1.2
    assert -90.0 < phase < 0.0
