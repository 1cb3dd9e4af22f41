"""The last gate: its bounds, and controllers and bugs that once pressed far beyond the limit."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any

import pytest
from hypothesis import given, strategies
from msgspec.structs import replace

from hil_bridge.clock import Clock, run_virtual
from hil_bridge.control.course import supervisor
from hil_bridge.control.types import Command, Measurement
from hil_bridge.devices.device_log import CallbackLog
from hil_bridge.devices.robots import ramp
from hil_bridge.devices.robots.gate import SLACK_M, Bounds, Gate, contradiction
from hil_bridge.runs import pace
from hil_bridge.runs.bounds import free_bounds, run_bounds
from hil_bridge.runs.compose import open_devices
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.configuration import Config
from hil_bridge.site.free import Freeing
from hil_bridge.site.tool.measuring import Sweep, measure
from protocol import geometry
from protocol.geometry import Pose, Quaternion, Vector, towards
from tests.near_surface import awake_config

pytestmark = pytest.mark.sweep

Guarded = Any
Run = Callable[..., Guarded]
ROBOTS = ["s3", "egm", "rtde", "rsi"]
BUG = "this is a bug of the program"
UPRIGHT = (0.0, 1.0, 0.0, 0.0)
START = Pose((0.9, -0.1, 0.592), UPRIGHT)
BOUNDS = Bounds(
    START,
    (0.0, 0.0, -1.0),
    0.02,
    (0.5, -0.5, 0.5),
    (1.3, 0.3, 0.6),
    math.radians(5.0),
    0.011,
    0.0275,
    0.1,
    math.radians(10.0),
    0.4,
)


def tracking(robot: str, stiffness: float, **more: Any) -> Config:
    """Some seconds of tracking with an emulated robot, at the period of its usual decisions."""
    slow = robot == "s3"
    values: dict[str, Any] = {
        "run": {"duration_s": 2.5 if slow else 0.6, "period_ms": 0 if slow else 20},
        "robot": {"emulated": robot},
        "sensor": {"emulated": "jr3" if slow else "netft"},
        "controller": {"sample_ms": 180 if slow else 20},
        "cell": {
            "start_position_mm": (900.0, -100.0, 591.0),
            "surface": {"stiffness_n_m": stiffness},
        },
        "task": {"retract_speed_mm_s": 20.0, "retract_mm": 4.0},
    }
    for name, section in more.items():
        values[name] = {**values.get(name, {}), **section}
    return awake_config(values)


def bound(config: Config) -> float:
    """The largest true force that may occur, N: see `docs/explanation/safety.md`."""
    cycle = config.run.period_ms * 1e-3 or 0.18
    deepest = config.limits.correction_mm_s * 1e-3 * cycle * 3
    return config.limits.force_limit_n + config.cell.surface.stiffness_n_m * deepest


class Lying:
    """A controller that is right at first, and then answers with one depth after the other."""

    name = "lying"

    def __init__(self, honest: Any, answers: Sequence[float], sample_ms: float) -> None:
        self._honest, self._answers, self.sample_ms = honest, answers, sample_ms

    def initial(self) -> tuple[int, Any]:
        return 0, self._honest.initial()

    def step(
        self, state: tuple[int, Any], measurement: Measurement, reference: float
    ) -> tuple[tuple[int, Any], Command]:
        number, inner = state
        inner, command = self._honest.step(inner, measurement, reference)
        if number >= 6:
            answer = self._answers[number % len(self._answers)]
            command = replace(command, position=answer)
        return (number + 1, inner), command


def lie(monkeypatch: pytest.MonkeyPatch, config: Config, *answers: float) -> None:
    make = pace.make_controller
    sample_ms = config.controller.sample_ms or 180.0
    monkeypatch.setattr(
        pace, "make_controller", lambda name, **values: Lying(make(name, **values), answers, sample_ms)
    )


# --- controllers that answer with invalid positions


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("stiffness", [5e3, 5e4])
def test_gate_huge_answer_ends_run(
    guarded: Run, monkeypatch: pytest.MonkeyPatch, robot: str, stiffness: float
) -> None:
    config = tracking(robot, stiffness)
    lie(monkeypatch, config, 3e15)
    run = guarded(config)
    assert "it commands 3000000000000000.0 m" in run.cause
    assert run.largest <= bound(config)
    assert run.result.left.startswith("retracted, ")


@pytest.mark.parametrize("answers", [(3e15, 1e-300), (-3e15, 3e15), (-1e300,), (1e3, -1e3)])
def test_gate_alternating_extremes_end_run(
    guarded: Run, monkeypatch: pytest.MonkeyPatch, answers: tuple[float, ...]
) -> None:
    config = tracking("egm", 5e4)
    lie(monkeypatch, config, *answers)
    run = guarded(config)
    assert "controller lying failed" in run.cause
    assert run.largest <= bound(config)


# --- bugs that are planted


@pytest.mark.parametrize("robot", ROBOTS)
def test_gate_stops_order_of_broken_guard(guarded: Run, monkeypatch: pytest.MonkeyPatch, robot: str) -> None:
    """The supervisor's clamp asks for 30 mm more than it says, from some cycle on."""
    clamp, calls = supervisor._clamp, []

    def broken(*arguments: Any) -> Any:
        verdict = clamp(*arguments)
        calls.append(verdict)
        if len(calls) != 30:
            return verdict
        x, y, z = verdict.position
        return replace(verdict, position=(x, y, z - 0.03))

    monkeypatch.setattr(supervisor, "_clamp", broken)
    config = tracking(robot, 5e4, run={"duration_s": 6.0 if robot == "s3" else 0.6})
    run = guarded(config)
    assert "30.0 mm from the depth that was decided" in run.cause
    assert run.cause.endswith("report it with the recording")
    assert run.largest <= bound(config)
    assert run.result.left.startswith("retracted, ")


@pytest.mark.parametrize("robot", ROBOTS)
def test_gate_stops_consistent_depth_leap(guarded: Run, monkeypatch: pytest.MonkeyPatch, robot: str) -> None:
    """Depth and position are both 30 mm deeper, so they agree with each other."""
    clamp, calls = supervisor._clamp, []

    def broken(*arguments: Any) -> Any:
        verdict = clamp(*arguments)
        calls.append(verdict)
        if len(calls) != 30:
            return verdict
        x, y, z = verdict.position
        return replace(verdict, depth=verdict.depth + 0.03, position=(x, y, z - 0.03))

    monkeypatch.setattr(supervisor, "_clamp", broken)
    config = tracking(robot, 5e4, run={"duration_s": 6.0 if robot == "s3" else 0.6})
    run = guarded(config)
    assert "into the surface faster than allowed" in run.cause
    assert run.largest <= bound(config)
    assert run.result.left.startswith("retracted, ")


@pytest.mark.parametrize("leap_mm", [0.5, 30.0])
def test_gate_stops_leaping_set_point(guarded: Run, monkeypatch: pytest.MonkeyPatch, leap_mm: float) -> None:
    """The path of a stream to its target overshoots once."""
    step, calls = ramp.Ramp.step, []

    def broken(self: ramp.Ramp, setpoint: Pose, goal: Pose, *arguments: Any) -> Pose:
        after = step(self, setpoint, goal, *arguments)
        calls.append(after)
        if len(calls) != 150:
            return after
        x, y, z = after.position
        return Pose((x, y, z - leap_mm * 1e-3), after.quaternion)

    monkeypatch.setattr(ramp.Ramp, "step", broken)
    config = tracking("egm", 5e4)
    run = guarded(config)
    assert len(calls) > 150
    assert BUG in run.cause
    assert run.largest <= bound(config)
    assert run.result.left.startswith("retracted, ")


@pytest.mark.parametrize("robot", ROBOTS)
def test_gate_stops_wrong_turn_by_own_arithmetic(
    guarded: Run, monkeypatch: pytest.MonkeyPatch, robot: str
) -> None:
    """Whoever measures a turn by `protocol.geometry` sees a twentieth of it: 90° at a corner pass for 4.5°."""
    right = geometry.turn_between

    def wrong(*arguments: Any) -> Quaternion:
        w, x, y, z = right(*arguments)
        return w, x / 20.0, y / 20.0, z / 20.0

    corner = {"kind": "polyline", "points_mm": [(0, 0), (1, 0), (1, 2)]}
    track = {"do": "track", "path": corner, "orientation": "along-path"}
    steps = {"step": [{"do": "approach"}, track, {"do": "retract"}]}
    config = tracking(robot, 5e4, run={"duration_s": 60.0}, task=steps)
    monkeypatch.setattr(geometry, "turn_between", wrong)
    run = guarded(config)
    assert "turned faster than allowed" in run.cause
    assert run.largest <= bound(config)
    assert run.result.left.startswith("retracted, ")


# --- each bound


def deeper(mm: float, across_mm: float = 0.0, base: Pose = START) -> Pose:
    x, y, z = base.position
    return Pose((x + across_mm * 1e-3, y, z - mm * 1e-3), base.quaternion)


def turned(degrees: float) -> Pose:
    half = math.radians(degrees) / 2.0
    return Pose(START.position, (0.0, math.cos(half), math.sin(half) * 0.0, math.sin(half)))


@pytest.mark.parametrize(
    ("pose", "expected"),
    [
        (deeper(5.0), "0.6 mm into the surface faster"),
        (deeper(0.0, 12.0), "1.0 mm across the approach faster"),
        (deeper(-9.0), "1.0 mm outside the workspace"),
        (deeper(25.0), "5.0 mm deeper than allowed"),
        (deeper(0.0, 500.0), "100.0 mm outside the workspace"),
        (turned(7.0), "2.0 ° tilted more"),
        (turned(4.9), "0.7 ° turned faster"),
        (Pose((math.nan, 0.0, 0.0), UPRIGHT), "the position (nan, 0.0, 0.0), which no arm can reach"),
        (Pose((1e300, 0.0, 0.0), UPRIGHT), "which no arm can reach"),
        (
            Pose(START.position, (0.0, 1.1, 0.0, 0.0)),
            "the orientation (0.0, 1.1, 0.0, 0.0), which is invalid",
        ),
        (Pose(START.position, (math.nan,) * 4), "which is invalid"),
    ],
)
def test_gate_each_bound_stops_a_pose(pose: Pose, expected: str) -> None:
    gate = Gate(BOUNDS, 0.0)
    message = gate.judge(pose, 0.0)
    assert expected in message
    assert message.endswith(f"{BUG}: report it with the recording")
    assert gate.judge(START, 0.0) == "", "a stopped order does not count"


def test_gate_tool_outside_may_stay_but_not_advance() -> None:
    """A robot with a noisy reported position was some µm deeper than in the first sample, and did not move."""
    gate = Gate(BOUNDS, 0.0, deeper(20.05))
    assert gate.judge(deeper(20.05), 0.0) == ""
    assert "mm deeper than allowed" in gate.judge(deeper(20.06), 1.0)
    assert "mm deeper than allowed" in Gate(BOUNDS, 0.0, deeper(20.2)).judge(deeper(20.2), 0.0)
    bounds = dataclasses.replace(BOUNDS, slack=0.0)
    gate = Gate(bounds, 0.0, deeper(-8.9))
    assert gate.judge(deeper(-8.9), 0.0) == "", "0.9 mm outside the box"
    assert "mm outside the workspace" in gate.judge(deeper(-8.91), 1.0)
    assert "mm outside the workspace" in Gate(bounds, 0.0, deeper(-9.1)).judge(deeper(-9.1), 0.0)


def test_gate_credit_grows_with_time_up_to_limit() -> None:
    gate = Gate(BOUNDS, 0.0)
    assert gate.judge(deeper(4.4), 0.0) == ""
    assert "faster" in gate.judge(deeper(6.6), 0.1)
    assert gate.judge(deeper(6.6), 0.2) == ""
    assert "faster" in gate.judge(deeper(6.6 + 4.5), 100.0)
    assert "faster" in gate.judge(deeper(6.7), -1.0), "a clock that goes back grants no credit"


@pytest.mark.parametrize("goal", [(0.0, 0.0, 0.25), (0.25, 0.0, 0.0), (0.0, -0.25, 0.0), (0.0, 0.0, -0.25)])
def test_gate_passes_an_order_of_the_full_credit_once(goal: Vector) -> None:
    """Deeper, to both sides and back, in numbers that floats hold exactly; nothing is left for a second order."""
    start = Pose((0.0, 0.0, 0.0), UPRIGHT)
    bounds = Bounds(start, deeper=0.25, across=0.25, away=0.25, time=1.0, slack=0.0)
    gate = Gate(bounds, 0.0)
    assert gate.judge(Pose(goal, UPRIGHT), 0.0) == ""
    x, y, z = (part * (1.0 + 2.0**-20) for part in goal)
    assert "faster than allowed" in gate.judge(Pose((x, y, z), UPRIGHT), 0.0)
    assert "faster than allowed" in Gate(bounds, 0.0).judge(Pose((x, y, z), UPRIGHT), 0.0)


def test_gate_retraction_gives_no_credit_for_depth() -> None:
    gate, depth, now = Gate(BOUNDS, 0.0), 0.0, 0.0
    for _ in range(3):
        depth, now = depth + 1.4, now + 1e-6
        assert gate.judge(deeper(depth), now) == ""
        depth -= 1.0
        assert gate.judge(deeper(depth), now) == ""
    assert "into the surface faster" in gate.judge(deeper(depth + 1.4), now)


def test_gate_set_point_stays_above_target() -> None:
    gate = Gate(BOUNDS, 0.0)
    assert "0.5 mm deeper than" in gate.judge(deeper(1.5), 0.0, 0.001)
    assert gate.judge(deeper(1.0), 0.0, 0.001) == ""


PARTS = strategies.floats(-1e3, 1e3) | strategies.floats(allow_nan=True, allow_infinity=True)


@given(strategies.lists(strategies.tuples(PARTS, PARTS, PARTS, strategies.floats(0.0, 10.0)), max_size=20))
def test_gate_pose_outside_bounds_never_passes(positions: list[tuple[float, float, float, float]]) -> None:
    """For any requests in any order, accepted poses are within the bounds and the speed limits."""
    gate, now, last, started = Gate(BOUNDS, 0.0), 0.0, 0.0, 0.0
    for x, y, z, passed in positions:
        now += passed
        for pose in (Pose((x, y, z), UPRIGHT), deeper(z % 40.0 - 10.0, x % 5.0 if math.isfinite(x) else 0.0)):
            if gate.judge(pose, now):
                continue
            depth = 0.592 - pose.position[2]
            assert depth <= 0.02 + 2 * SLACK_M
            assert depth - last <= 0.011 * (now - started + 0.4) + 2 * SLACK_M
            assert all(
                low - 2 * SLACK_M <= p <= high + 2 * SLACK_M
                for low, p, high in zip(BOUNDS.low, pose.position, BOUNDS.high, strict=True)
            )


def test_gate_depth_position_mismatch_is_named() -> None:
    approach: Vector = (0.0, 0.0, -1.0)
    assert contradiction((0.9, -0.1, 0.59), START.position, approach, 0.002) == ""
    assert "0.2 mm from the depth" in contradiction((0.9, -0.1, 0.59), START.position, approach, 0.0022)
    assert "nan mm from" in contradiction((math.nan, -0.1, 0.59), START.position, approach, 0.002)


def test_gate_freed_tool_only_moves_away() -> None:
    config = tracking("egm", 5e3)
    gate = Gate(free_bounds(config, Setup(config).facts, START), 0.0)
    assert gate.judge(deeper(-0.5), 1.0) == ""
    assert "deeper than allowed" in gate.judge(deeper(0.1), 2.0)
    assert "tilted" in gate.judge(turned(0.5), 2.0)


@pytest.mark.parametrize("robot", ROBOTS)
def test_gate_bounds_permit_each_step_of_a_run(robot: str) -> None:
    """The longest move of one decision, with the robot's registers rounded in either direction."""
    config = tracking(robot, 5e3)
    facts, sample = Setup(config).facts, config.controller.sample_ms or 180.0
    gate = Gate(run_bounds(config, facts, sample * 1e-3, False, START), 0.0)
    step, rounded = facts.order_step_m or 0.0, 0.0
    farthest = config.limits.correction_mm_s * 2.0 * sample * 1e-3
    pose = START
    for number in range(1, 5):
        rounded = step * (number % 2)
        pose = deeper(farthest * number + rounded * 1e3)
        assert gate.judge(pose, 2.0 * sample * 1e-3 * number) == ""


def test_gate_of_run_uses_configured_limits() -> None:
    limits = {
        "correction_total_mm": 30.0,
        "correction_mm_s": 11.0,
        "travel_mm_s": 27.0,
        "turn_total_deg": 6.0,
        "turn_deg_s": 8.0,
    }
    config = tracking("egm", 5e3, limits=limits)
    bounds = run_bounds(config, Setup(config).facts, 0.02, True, START)
    assert (bounds.start, bounds.approach) == (START, (0.0, 0.0, -1.0))
    assert (bounds.deepest, bounds.deeper, bounds.across) == pytest.approx((0.03, 0.011, 0.027))
    assert (bounds.tilt, bounds.turn) == pytest.approx((math.radians(6.0), math.radians(8.0)))
    lift = config.task.zero_lift_mm * 1e-3
    assert bounds.low == pytest.approx(tuple(position - lift for position in config.limits.workspace_min_m))
    assert bounds.high == pytest.approx(tuple(position + lift for position in config.limits.workspace_max_m))
    gate = Gate(bounds, 0.0)
    for number in range(1, 61):  # slowly, so that no speed is judged
        assert gate.judge(deeper(0.5 * number), float(number)) == ""
    assert "0.5 mm deeper than allowed" in gate.judge(deeper(30.5), 61.0)
    still = run_bounds(config, Setup(config).facts, 0.02, False, START)
    assert (still.tilt, still.turn) == (0.0, 0.0), "a run without a program does not turn the tool"


# --- it is silent while all is well


@pytest.fixture
def judged(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return the gate's message for each pose."""
    messages: list[str] = []
    judge = Gate.judge

    def listening(self: Gate, *arguments: Any) -> str:
        messages.append(judge(self, *arguments))
        return messages[-1]

    monkeypatch.setattr(Gate, "judge", listening)
    return messages


@pytest.mark.parametrize("robot", ROBOTS)
def test_gate_does_not_interfere_with_run(guarded: Run, judged: list[str], robot: str) -> None:
    run = guarded(tracking(robot, 5e3))
    assert run.result.left.startswith("retracted, ")
    assert len(judged) >= 20
    assert set(judged) == {""}


@pytest.mark.parametrize("robot", ROBOTS)
def test_gate_does_not_interfere_with_freeing(judged: list[str], robot: str) -> None:
    config = tracking(robot, 5e3, cell={"start_position_mm": (900.0, -100.0, 588.0)})

    async def main() -> None:
        clock = Clock.running()
        async with open_devices(Setup(config), clock, CallbackLog()) as devices:
            await Freeing(config, clock, devices.robot, devices.sensor, lambda text: None)(3.0)

    run_virtual(main)
    assert len(judged) >= 8
    assert set(judged) == {""}


@pytest.mark.parametrize("robot", ROBOTS)
def test_gate_does_not_interfere_with_turning(judged: list[str], robot: str) -> None:
    config = tracking(robot, 5e3)
    sweep = Sweep(angle_deg=6.0, lift_mm=10.0, settle_s=0.1, average_s=0.3)
    assert len(measure(config, True, sweep, lambda text: None)) == 6
    assert len(judged) >= 20
    assert set(judged) == {""}


def test_gate_stepped_move_is_judged_by_its_end() -> None:
    """Each set point of a path is within the bounds of its target."""
    gate, pose, goal = Gate(BOUNDS, 0.0), START, deeper(2.0, 3.0)
    for number in range(1, 400):
        pose = towards(pose, goal, 1e-5, 1.0)
        assert gate.judge(pose, number * 1e-2) == ""


def test_gate_refused_order_does_not_count() -> None:
    """Found by a hunt: a long move back was refused, and the next, short one was stopped as a jump deeper."""
    gate = Gate(BOUNDS, 0.0, deeper(5.0))
    assert gate.judge(deeper(-4.0), 1.0) == ""
    gate.take_back()
    assert gate.judge(deeper(4.0), 1.1) == ""
    assert "into the surface faster" in gate.judge(deeper(19.0), 1.2)


def test_gate_refused_retraction_is_repeated(guarded: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """The controller requests a long move back, and the robot refuses that one order."""
    refused = {"on": "robot", "fault": "refuses", "phase": "track", "after_s": 1.1, "with": {"code": 31}}
    values = tracking("s3", 5e3).model_dump(exclude_unset=True)
    config = awake_config({**values, "faults": [refused]})
    lie(monkeypatch, config, -0.02)
    run = guarded(config)
    assert "refused order" in run.cause
    assert not run.result.followed
    assert run.result.left.startswith("retracted")


def test_gate_noisy_start_depth_is_tolerated() -> None:
    """A real arm reports its position with a noise of 20 µm. An order to stay is not deeper; one below it is."""
    bounds = dataclasses.replace(BOUNDS, deepest=0.0)
    gate = Gate(bounds, 0.0, deeper(0.02))
    assert gate.judge(deeper(0.02), 1.0) == ""
    assert gate.judge(deeper(0.01), 1.1) == ""
    assert "deeper than allowed" in gate.judge(deeper(0.03), 1.2)
    assert "deeper than allowed" in Gate(bounds, 0.0).judge(deeper(0.02), 1.0)
    assert "deeper than allowed" in Gate(bounds, 0.0, deeper(0.5)).judge(deeper(0.5), 1.0), (
        "larger than any noise"
    )
