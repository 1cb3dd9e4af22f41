import dataclasses
import json
import math
import random
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec import structs

from hil_bridge.analysis.stream import stream_force
from hil_bridge.analysis.summary import summarise
from hil_bridge.errors import ConfigError
from hil_bridge.facts import Devices, Sensor
from hil_bridge.recording import CycleRecord, EventRecord, Outcome, Recording, RunEnd, SensorRecord
from hil_bridge.report import write_report
from hil_bridge.report.plots import draw
from protocol.wrench import SensorFacts

EVIL = "<script>alert('1')</script> & $x^"
END = RunEnd(Outcome.STOPPED, EVIL, 0.156, {EVIL: 1}, left=f"left {EVIL}", followed=("first", EVIL))
NEWTON_PER_COUNT, BIAS_COUNTS = 0.025, 37


def run(seconds: float = 8.0) -> Recording:
    """A noisy stream: the tool presses along −z, first with nothing, then up to 50 N."""
    chance, cycles, sensors = random.Random(3), [], []
    for k in range(round(seconds * 500)):
        pressed = 50.0 * (1 - math.exp(-max(0.0, k / 500 - 1)))
        z = round(-pressed / NEWTON_PER_COUNT + BIAS_COUNTS + chance.gauss(0, 20))
        sensors.append(SensorRecord(20.0 + k / 500, k, (round(chance.gauss(0, 9)), 4, z, 0, 0, 0)))
        if k % 80 == 79:
            at = sensors[-1].at
            cycles.append(
                CycleRecord(
                    cycle=k // 80,
                    phase="track" if k > 500 else "approach",
                    started_at=at - 0.07,
                    status_at=at,
                    sensor_at=at,
                    controlled_at=at + 0.0005,
                    sent_at=at + 0.001,
                    answered_at=at + 0.09,
                    sensor_sequence=k,
                    force=-(z - BIAS_COUNTS) * NEWTON_PER_COUNT,
                    force_reference=50.0,
                    wrench=(0.0,) * 6,
                    position=(0.0,) * 3,
                    quaternion=(1.0, 0.0, 0.0, 0.0),
                    depth=pressed / 2e4,
                    depth_commanded=pressed / 2e4,
                    travel_commanded=0.0,
                    correction=1e-4,
                    stiffness=2e4 if k > 900 else None,
                    held=k > 2000,
                    in_contact=k > 500,
                    verdict="clamp" if k < 800 else "allow",
                    reasons=("step",) if k < 800 else (),
                )
            )
    events = (EventRecord(25.0, "stop", EVIL), EventRecord(24.0, EVIL, EVIL))
    settings = {
        "sensor": {"quaternion": [1, 0, 0, 0], "mounting_deg": 90, "flip_fx_mx": False},
        "frame": {"approach": [0, 0, 1]},
    }
    facts = SensorFacts("", (NEWTON_PER_COUNT,) * 6, None, None, None, 0.0, "device")
    return Recording(
        tuple(cycles),
        tuple(sensors),
        events,
        {"controller": EVIL, "configuration": '{"a":[1,2]}', "config": json.dumps(settings)},
        devices=Devices(sensor=Sensor(facts=facts)).as_metadata(),
    )


def test_picture_and_page_are_written_and_the_same_each_time(tmp_path: Path) -> None:
    recording = run()
    summary = summarise(recording, END)
    page = write_report(recording, summary, tmp_path / "new" / "a")
    assert page == tmp_path / "new" / "a" / "report.html"
    picture = (tmp_path / "new" / "a" / "report.png").read_bytes()
    assert picture.startswith(b"\x89PNG\r\n\x1a\n")
    assert struct.unpack(">II", picture[16:24]) == (1400, 1600)
    assert len(picture) > 50_000
    again = write_report(recording, summary, tmp_path / "b")
    assert again.read_bytes() == page.read_bytes()
    assert again.with_name("report.png").read_bytes() == picture


def test_the_page_escapes_everything_and_loads_nothing(tmp_path: Path) -> None:
    recording = run()
    text = write_report(recording, summarise(recording, END), tmp_path).read_text()
    assert "<script" not in text
    assert text.count("&lt;script&gt;") >= 8
    assert text.index("<p>then: first</p><p>then: &lt;script") < text.index(
        "<p>left: <strong>left &lt;script"
    )
    assert 'src="data:image/png;base64,' in text
    assert "http" not in text
    assert json.dumps({"a": [1, 2]}, indent=2).replace('"', "&quot;") in text


def test_little_of_a_run_still_gives_a_picture() -> None:
    """One cycle, no stream, no estimate, no number known, not even a floor."""
    only = structs.replace(run().cycles[0], force=math.nan, answered_at=math.nan)
    recording = Recording((only,), truncated=True)
    assert draw(recording, summarise(recording)).startswith(b"\x89PNG")


def test_the_stream_is_scaled_by_the_facts_and_shifted_to_the_cycles() -> None:
    recording = run()
    stream = stream_force(recording)
    assert stream is not None
    at, low, high = stream
    true = np.array([-(s.counts[2] - BIAS_COUNTS) * NEWTON_PER_COUNT for s in recording.sensors])
    assert len(at) <= 3000
    assert (low <= high).all()
    assert low.min() == pytest.approx(true.min())
    assert high.max() == pytest.approx(true.max())


def test_a_stream_that_the_cycles_do_not_follow_is_not_drawn() -> None:
    recording = run()
    turned = tuple(
        structs.replace(cycle, force=-cycle.force if cycle.cycle % 2 else cycle.force)
        for cycle in recording.cycles
    )
    assert stream_force(dataclasses.replace(recording, cycles=turned)) is None
    assert stream_force(dataclasses.replace(recording, sensors=())) is None


@pytest.mark.parametrize("unknown", [{"devices": {}}, {"metadata": {}}])
def test_a_stream_is_not_drawn_without_scale_or_direction(unknown: dict[str, Any]) -> None:
    assert stream_force(dataclasses.replace(run(), **unknown)) is None


def test_a_place_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    recording = run(1.5)
    with pytest.raises(ConfigError, match="cannot make the directory"):
        write_report(recording, summarise(recording, END), tmp_path / "file")
