"""Stability of the loop and decisions of the controller, as the page derives them from a recording."""

import dataclasses
import json
import math
import re
import statistics
import struct
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from msgspec import structs

from emulators.arm.loops import ServoProfile
from emulators.arm.waypoints import Waypoint, WaypointArm
from hil_bridge.control.analysis.stability import (
    Quantiser,
    SampledPlant,
    admittance_response,
    limit_cycle,
    margins,
    pi_response,
)
from hil_bridge.devices.facts import Devices, RobotFacts, Sensor, ServoFacts
from hil_bridge.devices.robots.s3.hops import robot_hops
from hil_bridge.record import CycleRecord, Outcome, Recording, RunEnd
from hil_bridge.record.analysis.definition import quantity
from hil_bridge.record.analysis.summary import summarise
from hil_bridge.show.report import write_report
from hil_bridge.show.report.decision_tables import decisions, strongest_rules
from hil_bridge.show.report.plots import draw
from hil_bridge.show.report.sections import controller_section, cycle_sentence, stability_section
from hil_bridge.show.report.stability import Analysis, LinearLoop, analyse, dominant_period
from protocol.devices.jr3 import facts_of
from protocol.devices.s3.adlp import LinkProfile
from protocol.geometry import Pose
from tests.record.written_recordings import cycle_of

PERIOD, WAIT = 0.2, 0.1
STEP = 0.125e-3
"""Resolution of the position, m."""


def config(name: str = "pi", **parameters: Any) -> dict[str, Any]:
    return {
        "controller": {"name": name, "parameters": parameters},
        "cell": {"surface": {"stiffness_n_m": 7000.0, "material": {"kind": "linear"}}},
    }


SERVO = ServoFacts(0.02, 0.02, 40.0, 1.0, 0.5)


def cycle(k: int, force: float = 10.0, **others: Any) -> CycleRecord:
    at = 100.0 + k * PERIOD
    complete: dict[str, Any] = {
        "cycle": k,
        "phase": "track",
        "started_at": at,
        "status_at": at + 0.08,
        "sensor_at": at + 0.08,
        "controlled_at": at + 0.08,
        "sent_at": at + 0.08,
        "answered_at": at + 0.08 + WAIT,
        "sensor_sequence": k,
        "force": force,
        "force_reference": 10.0,
        "depth": 0.01,
        "depth_commanded": 0.01,
        "stiffness": 5000.0,
        "in_contact": True,
    }
    return cycle_of(**(complete | others))


def record(
    cycles: list[CycleRecord],
    settings: dict[str, Any] | None = None,
    delay_s: float = 0.0,
    **robot: Any,
) -> Recording:
    """Return cycles of a run with these facts of its robot, and this delay of the sensor's filter."""
    settings = config() if settings is None else settings
    name = settings.get("controller", {}).get("name", "")
    facts = {"kind": "s3", "emulated": True, "position_step_m": STEP, "servo": SERVO, **robot}
    devices = Devices(
        RobotFacts(**facts), Sensor("jr3", facts_of((115.0, 111.0, 185.0, 5.6, 5.2, 6.1), 0.01, delay_s))
    )
    metadata = {"controller": name, "config": json.dumps(settings)}
    return Recording(tuple(cycles), metadata=metadata, devices=devices.as_metadata())


def analysis(recording: Recording) -> Analysis:
    result = analyse(recording, summarise(recording))
    assert result is not None
    return result


def linear(recording: Recording) -> LinearLoop:
    loop = analysis(recording).loop
    assert loop is not None
    return loop


def section(recording: Recording) -> str:
    return stability_section(recording, summarise(recording))


def square(k: int) -> CycleRecord:
    """Return a force between two positions while the command crosses their border: ten samples per period."""
    up = k % 10 < 5
    return cycle(k, 10.3 if up else 9.7, depth_commanded=0.01 + (STEP if up else 0.0))


def test_stability_sample_time_and_delay_match_recording() -> None:
    result = analysis(record([cycle(k) for k in range(60)]))
    assert result.plant.period == pytest.approx(PERIOD)
    assert result.plant.delay == pytest.approx(WAIT + 0.5 * 0.02 + 0.02)
    assert [part.seconds for part in result.delay] == pytest.approx([WAIT, 0.01, 0.02])
    assert (result.stiffness, result.step_force) == pytest.approx((5000.0, 0.625))
    slower = analysis(record([cycle(k) for k in range(60)], delay_s=0.0159))
    assert slower.plant.delay - result.plant.delay == pytest.approx(0.0159)


def test_stability_move_is_accepted_at_start_of_response() -> None:
    late = analysis(record([cycle(k) for k in range(60)]))
    result = analysis(record([cycle(k) for k in range(60)], hops=robot_hops(LinkProfile())))
    # ENQ, ACK, a telegram of 8 in a block of 13, ACK, EOT: 11 bits each
    assert late.plant.delay - result.plant.delay == pytest.approx(17 * 11 / 9600)
    assert result.delay[0].label == "frame's arrival to the move's acceptance"


def test_stability_uses_filter_of_recorded_sensor() -> None:
    cycles = [cycle(k) for k in range(60)]

    def lags(recording: Recording) -> list[float]:
        return [part.seconds for part in analysis(recording).delay if part.label == "sensor's filter"]

    assert lags(record(cycles, delay_s=0.02771)) == [0.02771]
    assert lags(record(cycles, delay_s=0.0)) == []
    cut_off = dataclasses.replace(record(cycles), devices={})
    assert analyse(cut_off, summarise(cut_off)) is None, "it ended before it reported its devices"


def test_stability_margins_use_configured_controller() -> None:
    settings = config(proportional=0.1, integral=0.3, tuned_at_n_m=4000.0)
    recording = record([cycle(k) for k in range(60)], settings)
    plant = SampledPlant(analysis(recording).plant.period, analysis(recording).plant.delay, 40.0, 1.0)
    loop = linear(recording)
    expected = margins(5000.0, pi_response(0.1 / 4000.0, 0.3 / 4000.0), plant)
    assert loop.margins == expected
    text = section(recording)
    assert f">{expected.gain_margin:.2f}<" in text
    assert f">{expected.phase_margin_deg:.0f}°<" in text
    assert f">{expected.gain_crossover_rad_s:.2f} rad/s<" in text
    body = linear(record([cycle(k) for k in range(60)], config("admittance", mass_kg=50.0)))
    assert body.margins == margins(5000.0, admittance_response(50.0, 2200.0, plant.period), plant)


def test_stability_margin_vanishes_and_is_comfortable_at() -> None:
    loop = linear(recording := record([cycle(k) for k in range(60)]))
    plant = analysis(recording).plant
    assert margins(loop.unstable_from, loop.response, plant).gain_margin == pytest.approx(1.0)
    assert loop.comfortable_to is not None
    at, above = (margins(loop.comfortable_to * f, loop.response, plant) for f in (1.0, 1.01))
    assert at.gain_margin >= 2.0
    assert at.phase_margin_deg >= 45.0
    assert above.gain_margin < 2.0 or above.phase_margin_deg < 45.0


@pytest.mark.parametrize(
    ("stiffness", "sentence"),
    [
        (2000.0, "the loop is comfortable"),
        (15_000.0, "stable, but not comfortable"),
        (50_000.0, "the linear loop is unstable"),
    ],
)
def test_stability_sentence_rates_margins(stiffness: float, sentence: str) -> None:
    recording = record([cycle(k, stiffness=stiffness) for k in range(60)])
    unstable_from = linear(recording).unstable_from
    assert sentence in (text := section(recording))
    assert f"{round(unstable_from, -2):,.0f} N/m".replace(",", " ") in text
    assert ("unstable by itself" in text) == (stiffness == 50_000.0)


def test_stability_uses_recorded_scheduled_gain() -> None:
    scheduled = config(gain_scheduling=True)
    hard = record([cycle(k, stiffness=50_000.0, gain=0.1) for k in range(60)], scheduled)
    plain = record([cycle(k, stiffness=5000.0) for k in range(60)])
    assert linear(hard).margins.gain_margin == pytest.approx(linear(plain).margins.gain_margin)
    assert "follows the estimate" in section(hard)
    assert "follows the estimate" not in section(plain)


def test_only_linear_controllers_have_margins() -> None:
    cycles = [cycle(k) for k in range(60)]
    assert '"id":"phase"' in section(record(cycles))
    for settings in (config("fuzzy"), config("admittance", spring_n_m=100.0), config(proportional="x")):
        text = section(record(cycles, settings))
        assert "No margins" in text
        assert '"id":"phase"' not in text
        assert "Limit cycle" in text


def test_stability_idle_and_oscillating_runs_are_distinguished() -> None:
    rested = analysis(record([cycle(k) for k in range(60)]))
    assert "the command did not move: 0 steps/s" in cycle_sentence(rested)
    assert rested.dominant_period is None
    swung = analysis(record([square(k) for k in range(60)]))
    assert swung.predicted is not None
    assert swung.predicted.peak_to_peak == pytest.approx(0.625, rel=0.02)
    assert swung.dominant_period == pytest.approx(10 * PERIOD, rel=0.05)
    ratio = 0.6 / swung.predicted.peak_to_peak
    assert f"varied by 0.60 N, {ratio:.1f} times that" in cycle_sentence(swung)
    assert "the limit cycle due to the resolution" in cycle_sentence(swung)
    wild = [structs.replace(square(k), force=10.0 + 5.0 * (-1) ** (k // 5)) for k in range(60)]
    assert "does not explain that" in cycle_sentence(analysis(record(wild)))
    slight = [structs.replace(square(k), force=10.0 + 0.1 * (-1) ** (k // 5)) for k in range(60)]
    assert "do not form" in cycle_sentence(analysis(record(slight)))
    assert "no steady state" in cycle_sentence(analysis(record([cycle(k) for k in range(20)])))


def test_predicted_limit_cycle_includes_servo_dead_band() -> None:
    result = analysis(recording := record([square(k) for k in range(60)]))
    assert result.loop is not None
    expected = limit_cycle(5000.0, result.loop.response, result.plant, Quantiser(STEP, 0.5))
    assert result.predicted == expected
    assert (
        f"<td>period</td><td>{expected.period:.2f} s</td><td>{result.dominant_period:.2f} s</td>"
        in section(recording)
    )


def test_unstable_loop_has_no_phase_margin() -> None:
    recording = record([structs.replace(square(k), stiffness=200_000.0) for k in range(60)])
    assert '<td>phase margin</td><td class="value">none</td>' in section(recording)
    assert "the force within 0.60 N, 0.0 steps" in cycle_sentence(analysis(recording))


def test_noise_has_no_dominant_period() -> None:
    time = [k * PERIOD for k in range(40)]
    assert dominant_period(time, [math.sin(k * k * 1.7) for k in range(40)]) is None
    assert dominant_period(time, [math.sin(2 * math.pi * t / 1.3) for t in time]) == pytest.approx(
        1.3, rel=0.03
    )
    assert dominant_period(time[:20], [math.sin(t) for t in time[:20]]) is None


def test_stability_interpolator_wait_matches_emulator() -> None:
    """Its set point is then the full correction, which is closer than a tick moves."""
    profile, now = ServoProfile(), 50.0
    tick, transport = profile.interpolation_ms * 1e-3, profile.transport_delay_ms * 1e-3
    servo = ServoFacts(tick, transport, profile.natural_frequency_rad_s, profile.damping_ratio)
    waits = []
    for phase in range(50):
        arm = WaypointArm(profile, Pose((0.9, 0.0, 0.6), (0.0, 1.0, 0.0, 0.0)), 0.0)
        ordered = now + (phase + 0.5) / 50 * tick
        arm.enqueue(Waypoint((0.9, 0.0, 0.6 - 2 * STEP), (0.0, 1.0, 0.0, 0.0), 0.05), ordered)
        arm.path.advance(ordered + 1.0)
        accepted = arm.path.targets.begun_at(1)
        assert accepted is not None
        assert arm.path.at(accepted + 1e-6)[0].loops.set_point[2] == round(0.6 / STEP) - 2
        waits.append(accepted - ordered - transport)
    assert statistics.fmean(waits) == pytest.approx(servo.wait_s)


def test_stability_names_sources_of_stiffness_and_servo() -> None:
    unknown = [cycle(k, stiffness=None) for k in range(60)]
    assert analysis(record(unknown)).stiffness == 7000.0
    assert "as configured for the emulated robot" in section(record(unknown))
    known = [cycle(k, stiffness=4000.0 if k < 40 else 6000.0) for k in range(60)]
    real = record(known, emulated=False)
    assert analysis(real).stiffness == 5000.0
    assert "assumed, from the profile" in section(real)
    assert "emulated" not in section(real)


@pytest.mark.parametrize(
    "recording",
    [
        Recording((cycle(0), cycle(1)), metadata={"controller": "pi"}),
        Recording((cycle(0), cycle(1)), metadata={"controller": "pi", "config": "{"}),
        Recording((cycle(0), cycle(1)), metadata={"controller": "pi", "config": "[1]"}),
        record([cycle(0), cycle(1)], {"controller": 3} | {"controller": {"name": "pi"}}, servo=None),
        record([cycle(0, phase="approach"), cycle(1, phase="approach")]),
        record([cycle(0)]),
        record([cycle(0), cycle(1, started_at=100.0)]),
        record([cycle(0), cycle(1, started_at=100.0 + 1e-6)]),
        record([cycle(k, stiffness=None) for k in range(60)], emulated=False),
    ],
)
def test_sections_without_data_are_omitted(recording: Recording) -> None:
    assert section(recording) == ""


EXPLAINED = {
    "NB∧ZO→PM": 0.25,
    "NS∧ZO→PS": 0.75,
    "ZO∧ZO→ZO": 0.5,
    "PS∧PS→NS": 0.125,
    "level_error": -2.0,
    "level_change": 0.0,
    "level_output": 1.0,
    "feedforward_m": 0.0125,
    "band_n": 0.81,
    "relative_error": 0.04,
}


def test_decision_table_row_has_levels_rules_and_values() -> None:
    at = cycle(
        3,
        9.5,
        explanation=EXPLAINED,
        verdict="clamp",
        reasons=("step",),
        held=True,
        gain=0.5,
        correction=1.25e-4,
    )
    result = decisions(record([cycle(0), at]), zero=100.0)
    assert result is not None
    row = dict(zip(result.titles, result.rows[1], strict=True))
    assert row == {
        "time, s": "0.68",
        "force, N": "9.50",
        "error, N": "−0.50",
        "level of error": "−2",
        "level of change": "0",
        "level of output": "1",
        "strongest rules, weight": "NS∧ZO→PS 0.75, ZO∧ZO→ZO 0.50, NB∧ZO→PM 0.25",
        "estimate, N/m": "5000",
        "gain": "0.5",
        "correction, mm": "+0.125",
        "other values": "band 0.81 N, feedforward 12.500 mm, relative error 0.04",
        "verdict": "clamp: step, held",
    }


@pytest.mark.parametrize(
    ("value", "form", "unit", "text"),
    [
        (-0.0001, "+.3f", "mm", "0 mm"),
        (0.0001, "+.3f", "", "0"),
        (-0.5, "+.1f", "N", "−0.5 N"),
        (1, ".0f", "cycles", "1 cycle"),
        (None, ".0f", "N", "–"),
    ],
)
def test_zero_has_no_sign_and_one_is_singular(value: float | None, form: str, unit: str, text: str) -> None:
    assert quantity(value, 1, form, unit) == text


def test_empty_columns_and_sections_are_omitted(tmp_path: Path) -> None:
    plain = record([cycle(k) for k in range(5)])
    result = decisions(plain, 0.0)
    assert result is not None
    assert not [
        title for title in result.titles if "level" in title or "rule" in title or title == "other values"
    ]
    assert "strongest" not in controller_section(plain)
    assert "<details>" in controller_section(plain)
    assert controller_section(record([cycle(0, phase="approach")])) == ""
    text = write_report(plain, summarise(plain, RunEnd(Outcome.COMPLETED)), tmp_path).read_text()
    assert "Decisions of the controller" in text


def test_strongest_rules_are_counted_with_ties() -> None:
    first = {"A∧A→A": 0.5, "B∧B→B": 0.7, "level_error": 9.0}
    both = {"A∧A→A": 0.9, "B∧B→B": 0.9, "C∧C→C": 0.1}
    odd = {"C∧C→C": math.nan, "A∧A→A": 0.0}
    recording = record([cycle(k, explanation=e) for k, e in enumerate((first, both, odd, {}))])
    assert strongest_rules(recording) == [("B∧B→B", 2, pytest.approx(0.8)), ("A∧A→A", 1, 0.9)]
    assert "<td>B∧B→B</td><td>2</td><td>50.0 %</td><td>0.80</td>" in controller_section(recording)


def test_decision_table_has_at_most_200_rows() -> None:
    recording = record([cycle(k) for k in range(1000)])
    result = decisions(recording, 100.08)
    assert result is not None
    assert len(result.rows) == 200
    times = [float(row[0]) for row in result.rows]
    assert (times[0], times[-1]) == pytest.approx((0.0, 999 * PERIOD))
    steps = [b - a for a, b in pairwise(times)]
    assert max(steps) - min(steps) <= PERIOD + 0.011
    assert "200 of 1000" in controller_section(recording)


def test_sections_are_escaped_and_deterministic() -> None:
    evil = "<script>→&"
    cycles = [
        cycle(k, explanation={evil: 0.5, "<b>": 1.0}, verdict="<i>", reasons=("<u>",)) for k in range(50)
    ]
    recording = record(cycles)
    text = section(recording) + controller_section(recording)
    assert not re.search(r"<(script|b|i|u)>", text)
    assert text == section(recording) + controller_section(recording)


@pytest.mark.full
def test_picture_has_separate_levels_panel() -> None:
    def height(explanation: dict[str, float]) -> int:
        recording = record([cycle(k, explanation=explanation if k > 3 else {}) for k in range(8)])
        picture = draw(recording, summarise(recording))
        return int(struct.unpack(">II", picture[16:24])[1])

    assert height({"level_error": 1.0, "level_output": math.nan}) > height({"band_n": 1.0})
