"""Closed loop with the emulated cell over paced in-memory wires, in virtual time: its cycle and its ends."""

import math
import statistics
from collections.abc import Callable
from typing import Any

import pytest

from hil_bridge.control import Command, ControlLoop, Measurement
from hil_bridge.devices.robots.s3.room import ROBOT as S3
from hil_bridge.errors import Cause, DeviceError
from hil_bridge.record import CycleRecord, Outcome
from hil_bridge.settings.configuration import Config
from hil_bridge.settings.kinds import settings_of
from hil_bridge.testing.wires import Faults
from protocol.can.frame import CanFrame
from protocol.devices.jr3 import GatewayClientProfile
from protocol.devices.s3.adlp import LinkProfile
from protocol.devices.s3.timing import answer_time, line_floor
from protocol.geometry import angle_between
from tests.bench import Bench, RunBench

pytestmark = pytest.mark.sweep


def after(cycles: int, act: Callable[[Bench], object]) -> Callable[[Bench, CycleRecord], None]:
    """Call a function once, after this many cycles of tracking."""

    def meddle(bench: Bench, record: CycleRecord) -> None:
        if len(bench.tracked()) == cycles and record.phase == "track":
            act(bench)

    return meddle


@pytest.fixture(scope="module")
def plain(bench: RunBench) -> Bench:
    """Run with the defaults, for inspection only."""
    return bench()


class Listening:
    """Controller that only stores its inputs."""

    name = "listening"

    def __init__(self, fails_after: int = 1000) -> None:
        self.given: list[Measurement] = []
        self._fails_after = fails_after

    def initial(self) -> None:
        """Nothing to remember."""

    def step(self, state: None, measurement: Measurement, reference: float) -> tuple[None, Command]:
        """Go in and out."""
        self.given.append(measurement)
        if len(self.given) > self._fails_after:
            raise ArithmeticError("lost count")
        move = 1e-3 if len(self.given) % 4 < 2 else -1e-3
        return None, Command(measurement.commanded + move, 0.0)


def test_pair_has_force_and_position_of_same_time(bench: RunBench, monkeypatch: pytest.MonkeyPatch) -> None:
    listening = Listening()
    monkeypatch.setattr("hil_bridge.runs.pace.make_controller", lambda *_, **__: listening)
    bench(
        task={"loss_ms": 180e3, "approach_speed_mm_s": 5.5, "speed_mm_s": 0.0, "zero_lift_mm": 0.0},
        limits={"force_limit_n": 90.0},
    )
    moving = listening.given[4:]
    assert all(m.paired_force is not None for m in moving)
    # The dead band alone lets force and position differ, by half a step and the tail of the filter.
    origin = statistics.fmean(m.position - m.force_at_position / 5000.0 for m in moving)
    paired = [abs(5000.0 * (m.position - origin) - m.force_at_position) for m in moving]
    newest = [abs(5000.0 * (m.position - origin) - m.force) for m in moving]
    assert max(m.force for m in moving) - min(m.force for m in moving) > 5.0
    assert max(paired) < 1.0
    assert statistics.fmean(newest) > 3 * statistics.fmean(paired)


def test_ages_follow_the_profiles() -> None:
    assert answer_time(LinkProfile()) == pytest.approx(41 * 11 / 9600)
    assert GatewayClientProfile(cutoff_hz=10.0).delay == pytest.approx(0.0159, abs=1e-4)
    assert GatewayClientProfile(cutoff_hz=0.0).delay == 0.0


def test_raising_controller_is_named_and_retracts(bench: RunBench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hil_bridge.runs.pace.make_controller", lambda *_, **__: Listening(fails_after=5))
    run = bench()
    assert run.result.outcome is Outcome.STOPPED
    assert run.result.text.startswith(
        "controller listening failed: ArithmeticError: lost count (tests/runs/test_run.py:"
    )
    assert run.texts("stop") == [run.result.text]
    assert run.cycles[-1].phase == "retract"
    assert run.true_force == 0.0


def test_tool_travels_1_mm_per_cycle(plain: Bench) -> None:
    track = plain.tracked()
    travel = [record.travel_commanded for record in track]
    assert travel == pytest.approx([k * 1e-3 for k in range(1, len(track) + 1)])
    assert track[-1].sample.position[1] - track[0].sample.position[1] == pytest.approx(travel[-2], abs=0.003)


def test_cycle_takes_line_and_two_turnarounds(plain: Bench) -> None:
    floor = line_floor(LinkProfile())
    assert floor == pytest.approx(136 * 11 / 9600)  # computer-link specification, section 5
    times = [record.answered_at - record.started_at for record in plain.cycles]
    assert floor + 2 * 0.008 <= min(times)
    assert max(times) <= floor + 2 * 0.016 + 1e-6
    assert statistics.fmean(times) == pytest.approx(floor + 2 * 0.012, rel=0.02)


def test_order_request_is_sent_during_decision(bench: RunBench, monkeypatch: pytest.MonkeyPatch) -> None:
    runs: list[Any] = []
    ahead: list[int] = []
    behind: list[int] = []

    def bids_ahead() -> int:
        counters = runs[-1].robot.counters
        return counters["bid sent"] - counters["messages sent"]

    propose = ControlLoop.propose

    def watched(*arguments: Any) -> Any:
        ahead.append(bids_ahead())
        return propose(*arguments)

    monkeypatch.setattr(ControlLoop, "propose", watched)
    for period_ms, after in ((0.0, 1), (250.0, 0)):
        behind.clear()
        run = bench(
            meddle=lambda bench, record: behind.append(bids_ahead()),
            prepare=runs.append,
            run={"duration_s": 1.0, "period_ms": period_ms},
        )
        assert set(behind) == {after}, "until the next beat, the controller has the line"
        assert run.result.outcome is Outcome.COMPLETED
        assert bids_ahead() == run.robot.counters["line released"] == 0
    assert set(ahead) == {1}


def test_timestamps_are_in_order(plain: Bench) -> None:
    for record in plain.cycles:
        hops = (
            record.started_at,
            record.sample.now,
            record.controlled_at,
            record.sent_at,
            record.answered_at,
        )
        assert list(hops) == sorted(hops)
        assert 0.0 <= record.sample.now - record.sample.sensor_at <= 0.0102


def test_fixed_period_skips_missed_cycles(bench: RunBench) -> None:
    starts = [record.started_at for record in bench(run={"duration_s": 5.0, "period_ms": 250.0}).cycles]
    assert [b - starts[0] for b in starts] == pytest.approx([k * 0.25 for k in range(len(starts))], abs=1e-9)
    run = bench(run={"duration_s": 3.0, "period_ms": 100.0})
    starts = [record.started_at for record in run.cycles]
    assert [b - starts[0] for b in starts] == pytest.approx([k * 0.2 for k in range(len(starts))], abs=1e-9)
    assert run.texts("overrun")[0] == "1 cycles of 100 ms skipped"


def test_tare_removes_tool_weight(bench: RunBench) -> None:
    run = bench(cell={"tool": {"mass_kg": 3.0}})
    assert (
        max(abs(record.force) for record in run.cycles if record.phase == "approach" and record.depth < 0.002)
        < 0.1
    )
    assert run.result.outcome is Outcome.COMPLETED


def test_rotated_left_handed_sensor_reads_same_force(bench: RunBench, plain: Bench) -> None:
    """The flip negates Fx, which nothing excites here; the friction along the path must come out turned."""
    straight = plain.tracked()[-1]
    turned = bench(sensor={"mounting_deg": 90.0, "flip_fx_mx": True}).tracked()[-1]
    assert turned.force == pytest.approx(straight.force, abs=0.1)
    assert turned.sample.wrench[0] == pytest.approx(-straight.sample.wrench[1], abs=0.1)


def test_force_above_limit_retracts_with_cause(bench: RunBench) -> None:
    run = bench(
        task={"expected_stiffness_n_m": 500.0, "approach_speed_mm_s": 11.0},
        cell={"surface": {"stiffness_n_m": 5e4}},
    )
    assert run.result.outcome is Outcome.STOPPED
    assert "beyond 50 N" in run.result.text
    assert run.texts("stop") == [run.result.text]
    stop = next(record for record in run.cycles if record.verdict == "stop")
    assert stop.phase == "retract"
    assert -0.002 - 1e-9 <= stop.correction < 0.0
    assert run.true_force == 0.0
    start = stop.depth_commanded - stop.correction
    assert run.cycles[-1].depth_commanded == pytest.approx(start - 0.004, abs=1e-6)


def test_emergency_stop_in_track_ends_run_by_name(bench: RunBench) -> None:
    run = bench(after(5, lambda bench: bench.cell.robot.press_emergency_stop(bench.clock.now())))
    assert run.result.outcome is Outcome.STOPPED
    assert (
        "the robot cannot move: emergency stop, in standby; it reported operational error 13"
        in run.result.text
    )
    assert "; release the emergency stop at the controller's panel" in run.result.text
    assert "13 stop or emergency stop" in run.result.followed[0].text
    assert run.result.left.startswith("NOT retracted: left at ")
    assert run.true_force > 5.0, "the robot accepted no order to retract"
    assert run.ended_at - run.cycles[-1].answered_at < 10.0


def test_silent_sensor_is_stale_and_retracts(bench: RunBench) -> None:
    run = bench(after(5, lambda bench: setattr(bench.can, "cut", True)))
    assert run.result.outcome is Outcome.STOPPED
    assert "the newest force is" in run.result.text
    assert run.true_force == 0.0


def test_rebooted_gateway_has_lost_its_zero(bench: RunBench) -> None:
    run = bench(after(5, lambda bench: bench.can.inject([CanFrame(0x701)])))
    assert "restarted in mid-run" in run.result.text
    assert run.result.cause is Cause.SENSOR_FAILED
    assert run.true_force == 0.0


def test_dead_robot_link_ends_run_after_timeouts(bench: RunBench) -> None:
    run = bench(after(5, lambda bench: setattr(bench.line, "faults", Faults(loss=1.0))))
    assert run.result.outcome is Outcome.STOPPED
    assert "robot on memory:robot" in run.result.text
    assert run.result.left.startswith("NOT retracted: left at an unknown depth, ")
    assert run.ended_at - run.cycles[-1].answered_at < 25.0


def test_noisy_line_is_handled_by_repetition(bench: RunBench) -> None:
    run = bench(
        lambda bench, record: setattr(bench.line, "faults", Faults(corruption=2e-4)), run={"duration_s": 30.0}
    )
    assert run.result.outcome is Outcome.COMPLETED
    assert sum(run.robot.counters[name] for name in ("block repeated", "bid repeated", "NAK sent")) > 0


def test_run_without_surface_has_no_contact(bench: RunBench) -> None:
    run = bench(cell={"surface": {"height_mm": 400.0}}, task={"approach_depth_limit_mm": 8.0})
    assert run.result.outcome is Outcome.STOPPED
    assert run.result.text.startswith("no contact found within 8 mm: ")


def test_workspace_limits_the_tool(bench: RunBench) -> None:
    run = bench(
        limits={"workspace_min_m": (-3.0, -3.0, 0.595)},
        task={"approach_depth_limit_mm": 20.0, "retract_mm": 20.0},
        cell={"start_position_mm": (900.0, -100.0, 600.0)},
    )
    lowest = min(record.sample.position[2] for record in run.cycles)
    assert lowest >= 0.595 - 0.0625e-3
    assert run.result.text == "no contact found: the approach leaves the workspace"
    assert run.result.cause is Cause.HELD_APPROACH
    assert run.cycles[-1].depth_commanded < 0.0


def test_interrupted_run_retracts_and_reports_it(bench: RunBench) -> None:
    run = bench(after(5, lambda bench: bench.run.interrupt()))
    assert run.result.outcome is Outcome.INTERRUPTED
    assert run.cycles[-1].phase == "retract"
    assert run.true_force == 0.0


def test_run_in_emergency_stop_does_not_move(bench: RunBench) -> None:
    stop = r"emergency stop, in standby; it reported operational error 13\.0, .* s before; release the"
    with pytest.raises(DeviceError, match=stop):
        bench(prepare=lambda bench: bench.cell.robot.press_emergency_stop(bench.clock.now()))


@pytest.mark.parametrize("block_end", ["length", "trailer"])
def test_run_completes_with_observed_client_timing(bench: RunBench, block_end: str) -> None:
    """Also with a controller that ends a block at the first DLE ETX, as a real one most likely does."""
    link = {"profile": "observed-client"}
    run = bench(
        run={"duration_s": 10.0},
        robot={"s3": {"link": link}},
        cell={"s3": {"link": {**link, "block_end": block_end}}},
    )
    assert run.result.outcome is Outcome.COMPLETED
    assert statistics.fmean(record.force for record in run.tracked()[-20:]) == pytest.approx(10.0, abs=0.6)
    assert run.true_force == 0.0
    assert run.robot.counters["block repeated"] == run.robot.counters["10 03 in data"] == 0


def test_line_floor_follows_the_profile() -> None:
    assert line_floor(LinkProfile(baudrate=19200)) == pytest.approx(136 * 11 / 19200)
    assert line_floor(LinkProfile(parity="N", move_length=60)) == pytest.approx(144 * 10 / 9600)
    assert settings_of(Config(), S3).client.link == LinkProfile()


def test_travel_limit_is_named_as_end(bench: RunBench) -> None:
    run = bench(task={"travel_limit_mm": 5.0})
    assert (run.result.outcome, run.result.text) == (Outcome.COMPLETED, "travelled 5 mm")


def freeze_fz(bench: Bench, at: float | None) -> None:
    """Freeze the sensor's Fz channel; `at` is its value in counts, None for the newest."""
    sensor = bench.cell.sensor.jr3
    counts_from = sensor.counts_from

    def frozen(first: int, last: int) -> Any:
        nonlocal at
        block = counts_from(first, last).copy()
        if at is None and len(block):
            at = block[0, 2]
        block[:, 2] = at
        return block

    sensor.counts_from = frozen


def test_force_axis_dead_from_start_is_named(bench: RunBench) -> None:
    """On a slope the tool is pushed aside while Fz says nothing."""
    run = bench(
        prepare=lambda bench: freeze_fz(bench, 434),
        cell={"surface": {"kind": "sloped", "slope_deg": 15.0}},
        task={"approach_speed_mm_s": 1.1, "approach_depth_limit_mm": 40.0},
    )
    assert run.result.outcome is Outcome.STOPPED
    assert run.result.text == "fz of the force sensor did not change since the zero while other axes moved"
    assert run.true_force == 0.0


def test_force_axis_dying_in_contact_stops_press(bench: RunBench) -> None:
    forces: list[float] = []

    def meddle(bench: Bench, record: CycleRecord) -> None:
        if record.phase == "track" and not forces:
            freeze_fz(bench, None)
        if record.phase == "track":
            forces.append(bench.cell.true_state(record.sample.now).contact_force[2])

    run = bench(meddle, task={"force_n": 30.0}, run={"duration_s": 20.0})
    assert run.result.outcome is Outcome.STOPPED
    assert "the force stayed at" in run.result.text
    assert max(forces) < 50.0
    assert run.true_force == 0.0


def test_saturated_sensor_after_large_zero_stops(bench: RunBench) -> None:
    """The tool's weight drives Fz close to one limit, and the zero hides that. Pressing moves it through zero
    to the other, where the counts that the zero has moved come round.
    """
    small = {"full_scales_n": (20.0, 20.0, 20.0), "full_scales_nm": (5.6, 5.2, 6.1)}
    run = bench(
        cell={"jr3": {"sensor": small}, "tool": {"mass_kg": 3.0}, "surface": {"stiffness_n_m": 20_000.0}},
        task={"force_n": 80.0, "approach_speed_mm_s": 1.1},
        limits={"force_limit_n": 500.0, "resultant_limit_n": 500.0},
    )
    assert run.result.outcome is Outcome.STOPPED
    assert run.result.text == "the force sensor is at the end of its range"
    assert any(text.startswith("fz is at") for text in run.texts("sensor"))


def test_quiet_sensor_is_not_reported_as_frozen(bench: RunBench) -> None:
    """The least noise that recordings show, a slow filter, and a slow approach: counts stay constant for seconds."""
    run = bench(
        sensor={"jr3": {"gateway": {"cutoff_hz": 2.0}}},
        cell={"jr3": {"sensor": {"noise_counts": 0.5}}},
        task={"approach_speed_mm_s": 0.275},
    )
    assert run.result.outcome is Outcome.COMPLETED


def test_start_orientation_is_ordered_not_reported(bench: RunBench) -> None:
    """A robot that reports its orientation wrong by one degree must not be turned by it, cycle after cycle."""
    turn = after(3, lambda bench: bench.cell.inject("pose", "turned", bench.clock.now(), degrees=1.0))
    run = bench(turn)
    reported = [record.sample.quaternion for record in run.tracked()]
    assert math.degrees(angle_between(reported[0], reported[-1])) == pytest.approx(1.0, abs=0.02)
    assert run.result.outcome is Outcome.COMPLETED
