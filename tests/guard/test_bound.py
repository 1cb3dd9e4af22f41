"""Bound of the true force: by arithmetic, and for robots, sensors and periods without faults."""

import json
import math
import runpy
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

import hil_bridge
from emulators.arm.loops import PositionLoop
from hil_bridge.control.course.reaction import bound_n, servo_lag
from hil_bridge.control.types import Command, Measurement
from hil_bridge.devices.facts import Pacing, RobotFacts, ServoFacts
from hil_bridge.errors import Cause
from hil_bridge.record.device_facts import devices_of
from hil_bridge.runs.force_bound import force_bound_n
from hil_bridge.runs.reaction_times import force_age, reaction, robot_motion
from hil_bridge.runs.slow_cycles import SlowCycles
from hil_bridge.settings.configuration import read_config
from protocol.wrench import SensorFacts
from tests.near_surface import AWAKE

pytestmark = pytest.mark.sweep

ROOT = Path(__file__).resolve().parents[2]
PAGES = ROOT / "docs" / "explanation"
SENSOR = SensorFacts("", (1.0,) * 6, None, None, 0.01, 0.016, "device")
STREAM = RobotFacts(
    pacing=Pacing.STREAMED,
    cycle_s=0.004,
    servo=ServoFacts(0.004, 0.02, natural_frequency_rad_s=100.0, damping_ratio=1.0),
)


def test_reaction_times_add_up_for_any_cycle() -> None:
    quick, slow = (reaction(STREAM, SENSOR, cycle_s) for cycle_s in (0.004, 0.02))
    assert quick.age_s == pytest.approx(0.0365)
    assert quick.order_s == pytest.approx(0.008)
    assert quick.motion_s == pytest.approx(0.044)
    assert slow.total_s - quick.total_s == pytest.approx(0.016)


def test_polled_robot_has_order_within_cycle() -> None:
    requested = RobotFacts(servo=STREAM.servo)
    assert reaction(requested, SENSOR, 0.18).order_s == 0.18


def test_sensor_without_period_has_usual_age() -> None:
    polled = SensorFacts("", (1.0,) * 6, None, None, None, 0.0, "host")
    assert force_age(polled, wire_s=0.0) == 0.01


def test_robot_with_unknown_servo_has_no_bound() -> None:
    assert robot_motion(RobotFacts()) == math.inf
    assert bound_n(50.0, 5e4, 0.011, math.inf) == math.inf


def test_bound_is_limit_plus_reaction_distance() -> None:
    assert bound_n(50.0, 5e4, 0.01, 0.06) == pytest.approx(80.0)
    assert bound_n(50.0, 5e4, 0.01, 0.06, step_m=1e-4) == pytest.approx(85.0)


@pytest.mark.parametrize("damping", [0.2, 0.5, 0.67, 0.9, 1.0, 1.5])
def test_servo_travels_its_lag_after_set_point_stops(damping: float) -> None:
    """Compared with the loop in closed form: a ramp of 1 m/s that ends."""
    frequency = 50.0
    loop = PositionLoop(frequency, damping)
    behind = 2.0 * damping / frequency
    deepest = max(-behind * a + b for a, b, *_ in (loop.over(0.0005 * k) for k in range(1, 4000)))
    assert servo_lag(frequency, damping) == pytest.approx(behind + max(deepest, 0.0), abs=1e-4)


ROBOTS: dict[str, tuple[float, ...]] = {"s3": (0.0,), "egm": (4, 20), "rtde": (2, 8, 50), "rsi": (4, 12, 180)}
"""Robots, with some of the periods of each in ms; 0 is the pace of the robot's line."""
SENSORS = {"s3": "jr3", "egm": "ft300", "rtde": "netft", "rsi": "jr3-uart"}


def hit(robot: str, sensor: str, period_ms: float, stiffness_n_m: float) -> dict[str, Any]:
    """A run of a third of a second on a surface that may be harder than expected."""
    values: dict[str, Any] = {
        "run": {"duration_s": 0.3},
        "robot": {"emulated": robot},
        "sensor": {"emulated": sensor},
        "cell": {"surface": {"stiffness_n_m": stiffness_n_m}, **AWAKE},
        "task": {"retract_mm": 2.0, "retract_speed_mm_s": 20.0, "zero_lift_mm": 0.25},
    }
    if period_ms:
        values["run"]["period_ms"] = period_ms
        values["controller"] = {"sample_ms": period_ms}
        values["cell"]["start_position_mm"] = [900.0, -100.0, 591.0]
    return values


@pytest.mark.parametrize("stiffness_n_m", [5e3, 5e4])
@pytest.mark.parametrize(
    ("robot", "period_ms"), [(robot, period) for robot, periods in ROBOTS.items() for period in periods]
)
def test_true_force_stays_below_bound(robot: str, period_ms: float, stiffness_n_m: float) -> None:
    values = hit(robot, SENSORS[robot], period_ms, stiffness_n_m)
    recording = hil_bridge.simulate(values).recording
    starts = [cycle.started_at for cycle in recording.cycles]
    longest_s = max(b - a for a, b in pairwise(starts))
    bound = force_bound_n(read_config(values), devices_of(recording), stiffness_n_m, longest_s)
    assert max(math.hypot(*truth.force) for truth in recording.truths) <= bound


@pytest.mark.parametrize("ms", [30.0, 200.0])
def test_slow_line_ends_run_before_touch(ms: float) -> None:
    """Each byte is delayed by this time: a cycle takes 0.8 or 3.5 s."""
    slow = {"on": "wire", "fault": "late", "phase": "connect", "for_s": 3600.0, "with": {"ms": ms}}
    recording = hil_bridge.simulate(hit("s3", "jr3", 0.0, 5e4), faults=[slow]).recording
    assert "the line to the robot is too slow" in recording.end["text"]
    assert recording.end["cause"] == Cause.SLOW_CYCLES
    assert max(math.hypot(*truth.force) for truth in recording.truths) == 0.0
    assert recording.end["left"] == "retracted, 0.0 N"


class Push:
    """A controller that goes deeper at 10.9 mm/s whatever the force: a hair below `limits.correction_mm_s`."""

    name = "push"

    def __init__(self, sample_ms: float) -> None:
        self.sample_ms = sample_ms

    def initial(self) -> None:
        """It keeps nothing."""

    def step(self, state: None, measurement: Measurement, reference: float) -> tuple[None, Command]:
        """Deeper."""
        correction = 0.0109 * measurement.dt
        return None, Command(measurement.commanded + correction, correction)


@pytest.mark.parametrize(
    ("robot", "sensor", "period_ms"),
    [
        ("s3", "jr3", 0),
        ("egm", "ft300", 4),
        ("egm", "jr3", 20),
        ("rtde", "ft300", 8),
        ("rsi", "ft300", 4),
        ("rsi", "netft", 50),
    ],
)
def test_pushed_tool_stays_below_bound(robot: str, sensor: str, period_ms: int) -> None:
    """On a surface ten times as hard as expected: the limit is passed at full speed."""
    values = hit(robot, sensor, period_ms, 5e4)
    values.pop("controller", None)
    values["run"]["duration_s"] = 0.6  # a compliant arm needs longer to press with the limit
    recording = hil_bridge.simulate(values, controller=Push(period_ms or 180.0)).recording
    longest_s = max(b.started_at - a.started_at for a, b in pairwise(recording.cycles))
    bound = force_bound_n(read_config(values), devices_of(recording), 5e4, longest_s)
    assert 50.0 < max(math.hypot(*truth.force) for truth in recording.truths) <= bound
    assert "contact force" in recording.end["text"]


def tool() -> dict[str, Any]:
    """The names of the program that writes the tables."""
    return runpy.run_path(str(ROOT / "tools" / "bound_doc.py"))


def figures() -> dict[str, Any]:
    """Those that the tables are made of."""
    kept: dict[str, Any] = json.loads((PAGES / "bound.json").read_text(encoding="utf-8"))
    return kept


def test_table_forces_stay_below_bound() -> None:
    for periods in figures()["bound"].values():
        for by_case in periods.values():
            for cells in by_case.values():
                assert all(force <= bound for force, bound in cells.values())


@pytest.mark.parametrize(
    "job", [("s3", "jr3", 0, "50"), ("egm", "ft300", 4, "pushed"), ("rsi", "ati-can", 20, "5")]
)
def test_table_figure_is_reproduced(job: tuple[str, str, int, str]) -> None:
    robot, sensor, period_ms, case = job
    then = figures()["bound"][robot][str(period_ms)][case][sensor]
    assert tool()["measured"](job) == pytest.approx(then, rel=0.02)


@pytest.mark.parametrize(
    ("robot", "late", "column"), [("s3", "forces", 4), ("egm", "forces, much", 8), ("rsi", "link", 0)]
)
def test_touch_table_figure_is_reproduced(robot: str, late: str, column: int) -> None:
    """The largest of the seeds of one cell, with its outcome."""
    program = tool()
    cells = [(k, v) for k in program["TOUCH_KN_M"] for v in program["TOUCH_MM_S"]]
    runs = [program["force_of_touch"]((robot, late, *cells[column], seed)) for seed in program["TOUCH_SEEDS"]]
    force, outcome = figures()["touch"][robot][late][column]
    assert max(runs) == (pytest.approx(force, rel=0.02), outcome)


def cycles_of(*lengths_s: float, **more: Any) -> list[bool]:
    """Return whether the run must end, at each start of cycles of these durations."""
    watch, now = SlowCycles(read_config(more)), 5.0
    ends = [watch.cycle(now) is not None]
    for length_s in lengths_s:
        now += length_s
        ends.append(watch.cycle(now) is not None)
    return ends


def test_few_slow_cycles_are_tolerated() -> None:
    assert not any(cycles_of(0.2, 3.0, 3.0, 0.2, 3.0, 3.0))


def test_three_slow_cycles_are_reported_once() -> None:
    assert cycles_of(0.6, 0.6, 0.6, 0.6) == [False, False, False, True, False]


def test_slow_configured_period_is_allowed() -> None:
    assert not any(cycles_of(0.9, 0.9, 0.9, 0.9, run={"period_ms": 500.0}))


@pytest.mark.parametrize(("period_ms", "allowed_s"), [(180.0, 0.5), (400.0, 0.8)])
def test_slow_cycles_allow_the_larger_of_setting_and_two_periods(period_ms: float, allowed_s: float) -> None:
    for took_s, ends in ((allowed_s - 0.01, False), (allowed_s + 0.01, True)):
        assert any(cycles_of(took_s, took_s, took_s, run={"period_ms": period_ms})) is ends
