import json
import math
import os
import random
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec import structs

from hil_bridge.devices.facts import Devices, RobotFacts
from hil_bridge.errors import Cause, ConfigError, Reason
from hil_bridge.record import (
    CycleRecord,
    EventKind,
    EventRecord,
    Outcome,
    Recorder,
    Recording,
    RunEnd,
    SensorRecord,
    Writing,
    read,
)
from hil_bridge.record.analysis.summary import end_of, phases, summarise
from hil_bridge.record.analysis.times import times_of
from hil_bridge.record.files import write_atomically
from tests.record.written_recordings import cycle_of

PERIOD, LSB = 0.25, 0.000125
END = RunEnd(
    Outcome.STOPPED,
    Reason(Cause.FORCE, "force limit"),
    0.156,
    {"nak": 2, "turnaround_mean_ms": 12.5},
    left="NOT retracted: left at 1.9 mm, 9.8 N, because the link broke",
    followed=(
        Reason(Cause.REFUSED_ORDER, "a point was refused"),
        Reason(Cause.DEAD_LINK, "the link broke", "look at the cable", "2 (track)"),
    ),
)


def cycles(forces: Sequence[float], phase: str = "track", first: int = 0) -> tuple[CycleRecord, ...]:
    """Return one cycle per force, every PERIOD, of 0.1 s plus 1 ms for each; the command moves 1 LSB."""
    return tuple(
        cycle_of(
            cycle=k,
            phase=phase,
            started_at=50.0 + k * PERIOD,
            status_at=50.07 + k * PERIOD,
            sensor_at=50.07 + k * PERIOD,
            controlled_at=50.08 + k * PERIOD,
            sent_at=50.08 + k * PERIOD,
            answered_at=50.1 + k * PERIOD + k * 0.001,
            sensor_sequence=k,
            force=force,
            force_reference=50.0,
            depth_commanded=LSB * (k % 2),
            held=k % 10 == 0,
            in_contact=force > 1.0,
            verdict="clamp" if k == 1 else "allow",
        )
        for k, force in enumerate(forces, start=first)
    )


STEP = [0.0, 20.0, 45.0, 60.0] + [49.0, 52.0] * 30


@pytest.mark.parametrize(("step_mm", "steps"), [(0.125, 1.0), (0.0625, 2.0)])
def test_summary_uses_resolution_of_recorded_robot(step_mm: float, steps: float) -> None:
    facts = Devices(RobotFacts(position_step_m=step_mm * 1e-3)).as_metadata()
    summary = summarise(Recording(cycles(STEP), devices=facts), END)
    assert summary.figures["steps_per_s"] == pytest.approx(steps / PERIOD)


def test_summary_figures_of_known_step() -> None:
    """Rise at the third sample, 20 % above, then alternately 49 and 52 N: mean 50.5, 3 N peak to peak."""
    summary = summarise(Recording(cycles(STEP)), END)
    figures = summary.figures
    assert figures["rise_samples"] == 2
    assert figures["rise_s"] == pytest.approx(2 * PERIOD)
    assert figures["overshoot_percent"] == pytest.approx(20.0)
    assert figures["steady_mean_error_n"] == pytest.approx(0.5)
    assert figures["steady_peak_to_peak_n"] == pytest.approx(3.0)
    assert figures["steps_per_s"] is None, "the record lacks the robot's resolution"
    assert figures["contact_losses"] == 0
    assert figures["largest_force_n"] == 60.0
    assert summary.force_mean_steady_n == pytest.approx(50.5)
    assert summary.force_reference_n == 50.0


def test_summary_times_and_counts() -> None:
    summary = summarise(Recording(cycles([50.0] * 101)), END)
    assert summary.cycle_time is not None
    assert summary.cycle_time.mean_s == pytest.approx(0.15)
    assert summary.cycle_time.p50_s == pytest.approx(0.15)
    assert summary.cycle_time.p90_s == pytest.approx(0.19)
    assert summary.cycle_time.p99_s == pytest.approx(0.199)
    assert summary.cycle_time.max_s == pytest.approx(0.2)
    assert summary.cycle_rate_hz == pytest.approx(1 / PERIOD)
    assert (summary.cycles, summary.cycles_clamped, summary.cycles_held) == (101, 1, 11)
    assert (summary.outcome, summary.cause, summary.text) == ("stopped", "force", "force limit")
    assert summary.line_floor_s == 0.156


def test_summary_figures_cover_tracking_only() -> None:
    approach = cycles([0.0, 99.0], "approach")
    summary = summarise(Recording((*approach, *cycles(STEP, first=2))), END)
    assert summary.figures["largest_force_n"] == 60.0
    assert summarise(Recording(approach), END).figures == {}
    assert summarise(Recording(cycles([50.0] * 39)), END).force_mean_steady_n is None


def test_summary_largest_force_includes_stopping_sample() -> None:
    """From 45 N to 235 N between two samples: the stopping sample is the overshoot."""
    tracked = cycles([0.0, 20.0, 45.0, *[45.0] * 40])
    (stopped,) = cycles([235.0], "retract", first=43)
    behind = cycles([400.0], "retract", first=44)
    figures = summarise(Recording((*tracked, stopped, *behind)), END).figures
    assert figures["largest_force_n"] == 235.0
    assert figures["overshoot_percent"] == pytest.approx(370.0)
    assert figures["steady_peak_to_peak_n"] == 0.0, "the other figures describe the tracking"
    assert figures["rms_error_n"] == summarise(Recording(tracked), END).figures["rms_error_n"]
    requested = structs.replace(stopped, asked="time is up")
    for ended in (
        summarise(Recording((*tracked, stopped)), replace(END, outcome=Outcome.COMPLETED)),
        summarise(Recording((*tracked, requested)), END),
        summarise(Recording((*tracked, *cycles([235.0], "approach", first=43))), END),
        summarise(Recording((*tracked, *cycles([math.nan], "retract", first=43))), END),
    ):
        assert ended.figures["largest_force_n"] == 45.0


def test_summary_of_force_stop_contains_the_force(bench: Callable[..., Any]) -> None:
    run = bench(
        task={"expected_stiffness_n_m": 500.0, "approach_speed_mm_s": 11.1},
        limits={"correction_mm_s": 20.0},
        cell={"surface": {"stiffness_n_m": 5e4}},
    )
    limit = next(cycle for cycle in run.cycles if cycle.verdict == "stop")
    assert limit.force > 50.0 > max((cycle.force for cycle in run.tracked()), default=0.0)
    summary = summarise(Recording(tuple(run.cycles)), replace(END, outcome=run.result.outcome))
    assert summary.figures["largest_force_n"] == limit.force


def test_summary_counts_lost_frames_and_dropped_records() -> None:
    sensors = tuple(SensorRecord(0.0, 78 * k, (0,) * 6) for k in range(5))
    complete = Recording(cycles(STEP), sensors, end={"dropped/sensor": "3"})
    summary = summarise(complete, replace(END, sensor_lost=4))
    assert (summary.sensor_frames_received, summary.sensor_frames_lost) == (8, 4)
    assert summarise(complete, END).sensor_frames_lost is None


def test_phases_from_events_or_else_cycles() -> None:
    both = (*cycles([0.0, 0.0], "approach"), *cycles([50.0] * 8, first=2))
    assert summarise(Recording(both), END).phases_s == pytest.approx({"approach": 0.5, "track": 1.859})
    events = tuple(
        EventRecord(at, EventKind.PHASE, name)
        for at, name in (
            (48.0, "connect"),
            (49.0, "track"),
            (51.0, "approach"),
            (52.0, "track"),
            (60.0, "end"),
        )
    )
    recording = Recording(both, events=events)
    assert summarise(recording, END).phases_s == pytest.approx(
        {"connect": 1.0, "track": 10.0, "approach": 1.0}
    )
    assert [span.name for span in phases(recording)] == ["connect", "track", "approach", "track"]


def test_run_end_is_stored_in_recording(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    metadata = {"controller": "fuzzy-pi", "seed": "7"}
    recorder = Recorder(path, lambda at: round(at * 1e9), metadata, Writing(threaded=False))
    for cycle in cycles(STEP):
        recorder.put(cycle)
    recorder.close(END.as_metadata())
    recording = read(path)
    assert end_of(recording) == END
    assert summarise(recording) == summarise(Recording(cycles(STEP), metadata=metadata), END)


@pytest.mark.parametrize(
    "end_record",
    [
        {},
        {"outcome": "exploded", "line_floor_s": "soon", "link": "[1"},
        {"outcome": "", "link": '{"a": "b"}', "line_floor_s": '"1"'},
    ],
)
def test_missing_or_invalid_end_counts_as_interrupted(end_record: dict[str, str]) -> None:
    end = end_of(Recording(cycles(STEP), end=end_record))
    assert (end.outcome, end.line_floor_s, end.link) == (Outcome.INTERRUPTED, None, {})


def test_summary_json_is_strict_stable_and_complete(tmp_path: Path) -> None:
    broken = RunEnd(Outcome.COMPLETED, link={"age_s": math.nan})
    summary = summarise(Recording(cycles(STEP)), broken)
    summary.write_json(tmp_path / "summary.json")
    text = (tmp_path / "summary.json").read_text()
    assert text == summarise(Recording(cycles(STEP)), broken).as_json()
    data = json.loads(text, parse_constant=pytest.fail)
    assert data["link"] == {"age_s": None}
    assert data["cycle_time"]["max_s"] == pytest.approx(0.163)
    assert [path.name for path in tmp_path.iterdir()] == ["summary.json"]


def test_failed_summary_write_keeps_the_old_file(tmp_path: Path) -> None:
    summary = summarise(Recording(cycles(STEP)), END)
    with pytest.raises(ConfigError, match=r"cannot write .*nowhere/summary\.json: no such folder"):
        summary.write_json(tmp_path / "nowhere" / "summary.json")
    (tmp_path / "taken").mkdir()
    with pytest.raises(ConfigError, match="cannot write"):
        summary.write_json(tmp_path / "taken")
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]


def test_summary_write_follows_links_and_accepts_pipes(tmp_path: Path) -> None:
    target, link, pipe = tmp_path / "target.json", tmp_path / "link.json", tmp_path / "pipe"
    target.write_text("old")
    link.symlink_to(target)
    with pytest.raises(ConfigError, match=r"link\.json already exists"):
        write_atomically(link, b"new")
    assert target.read_text() == "old"
    write_atomically(link, b"new", overwrite=True)
    assert (target.read_text(), link.is_symlink()) == ("new", True)
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    write_atomically(pipe, b"through")
    assert os.read(reader, 100) == b"through"
    os.close(reader)
    assert pipe.is_fifo()


def test_percentiles_match_numpy() -> None:
    draw = random.Random(3)
    for count in (1, 2, 3, 10, 100, 101, 333):
        durations = [draw.choice((draw.random(), draw.randrange(9) * 1e-3)) for _ in range(count)]
        times = times_of([*durations, math.nan])
        assert times is not None
        expected = [float(value) for value in np.percentile(durations, (50, 90, 99))]
        assert [times.p50_s, times.p90_s, times.p99_s, times.max_s] == [*expected, max(durations)]
