"""The travel rises to its speed, so that an unknown slope shows before the tool goes fast."""

from typing import Any

import pytest
from msgspec.structs import replace

from hil_bridge.control import Command, Measurement, Phase, Stroke, StrokeState, TaskParameters
from hil_bridge.control.course.stroke import Stride
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.configuration import read_config
from protocol.marks import SettingError

FORCE = 10.0
DT = 0.004
SPEED, RISE = 5.5, 1.2


class Rests:
    """Never moves."""

    name = "rests"

    def initial(self) -> int:
        return 0

    def step(self, state: int, measurement: Measurement, reference: float) -> tuple[int, Command]:
        return state, Command(measurement.commanded, 0.0)


def tracking(**settings: Any) -> tuple[Stroke, StrokeState]:
    task = TaskParameters(**{"speed_mm_s": SPEED, "travel_rise_s": RISE, **settings})
    return Stroke(task, Rests()), StrokeState(phase=Phase.TRACK, in_contact=True, controller=0)


def travelling(
    stroke: Stroke, state: StrokeState, samples: int, stride: Stride | None = None, **more: Any
) -> tuple[StrokeState, list[float]]:
    """State after some samples of tracking, and the way of each, m."""
    ways = []
    measurement = Measurement(0.0, more.pop("force", FORCE), 0.0, 0.0, dt=more.pop("dt", DT), **more)
    for _ in range(samples):
        before = state.travel
        state, _ = stroke.step(state, measurement, stride or Stride(FORCE))
        ways.append(state.travel - before)
    return state, ways


def first(samples: int, dt: float = DT) -> list[float]:
    """The ways that the first samples of a travel must have, m."""
    return [min(k * dt / RISE, 1.0) * SPEED * 1e-3 * dt for k in range(1, samples + 1)]


@pytest.mark.parametrize("dt", [0.002, 0.004, 0.012, 0.05, 0.179])
def test_the_speed_rises_linearly_and_stays(dt: float) -> None:
    samples = round(1.5 * RISE / dt)
    _, ways = travelling(*tracking(), samples, dt=dt)
    assert ways == pytest.approx(first(samples, dt), rel=1e-9, abs=1e-15)


def test_it_begins_when_the_force_lets_the_tool_travel() -> None:
    stroke, state = tracking(travel_from_share=0.8)
    state, ways = travelling(stroke, state, 1, force=7.9)
    assert ways == [0.0]
    _, ways = travelling(stroke, replace(state, settled=False), 3, force=8.0)
    assert ways == pytest.approx(first(3))


@pytest.mark.parametrize("dt", [0.0, 0.004, 0.18])
def test_without_a_rise_the_first_sample_goes_at_full_speed(dt: float) -> None:
    stroke, state = tracking(travel_rise_s=0.0)
    assert travelling(stroke, state, 1, dt=dt)[1] == [stroke.way(SPEED, dt)]


def test_a_sample_without_time_changes_nothing() -> None:
    stroke, state = tracking()
    state, _ = travelling(stroke, state, 10)
    after, ways = travelling(stroke, state, 1, dt=0.0)
    assert ways == [0.0]
    assert after.speed_mm_s == state.speed_mm_s > 0.0


@pytest.mark.parametrize(("advance", "feed"), [(0.0, 1.0), (1.0, 0.0), (1.0, -0.5)])
def test_a_travel_that_stood_or_went_back_rises_anew(advance: float, feed: float) -> None:
    stroke, state = tracking()
    state, _ = travelling(stroke, state, 400)
    assert state.speed_mm_s == SPEED
    state, ways = travelling(stroke, state, 1, Stride(FORCE, feed), advance=advance)
    assert ways == pytest.approx([feed * advance * SPEED * 1e-3 * DT])
    assert travelling(stroke, state, 3)[1] == pytest.approx(first(3))


def test_a_lost_contact_and_a_new_approach_begin_it_anew() -> None:
    stroke, state = tracking()
    fast, _ = travelling(stroke, state, 400)
    lost, ways = travelling(stroke, fast, 1, force=0.0)
    assert ways == [0.0]
    assert travelling(stroke, lost, 3)[1] == pytest.approx(first(3))
    assert travelling(stroke, stroke.tracking(replace(fast, phase=Phase.APPROACH)), 3)[1] == pytest.approx(
        first(3)
    )
    on = stroke.tracking(fast)  # another step of the same touch
    assert travelling(stroke, on, 1)[1] == pytest.approx([SPEED * 1e-3 * DT])


def test_a_slow_sample_costs_its_own_way_alone() -> None:
    stroke, state = tracking()
    state, _ = travelling(stroke, state, 400)
    state, slow = travelling(stroke, state, 1, Stride(FORCE, 0.5))
    assert slow == pytest.approx([0.5 * SPEED * 1e-3 * DT])
    assert travelling(stroke, state, 1)[1] == pytest.approx([SPEED * 1e-3 * DT])


def resolved(robot: str, **sections: dict[str, Any]) -> Setup:
    devices = {"robot": {"emulated": robot}, "sensor": {"emulated": "jr3" if robot == "s3" else "netft"}}
    return Setup(read_config({**devices, **sections}))


@pytest.mark.parametrize(
    ("robot", "follows", "given", "rise"),
    [
        ("s3", True, None, None),
        ("rtde", True, None, RISE),
        ("egm", True, None, RISE),
        ("rsi", True, None, RISE),
        ("egm", False, None, None),
        ("egm", True, 0.0, 0.0),
        ("rtde", False, 0.5, 0.5),
    ],
)
def test_the_default_by_robot_stands_in_the_record(
    robot: str, follows: bool, given: float | None, rise: float | None
) -> None:
    task = {} if given is None else {"travel_rise_s": given}
    setup = resolved(robot, frame={"follow_normal": follows}, task=task)
    assert setup.config.task.travel_rise_s == rise
    assert setup.loop.program.parameters.travel_rise_s == rise


def test_a_recording_from_before_the_setting_is_replayed_as_it_was() -> None:
    """A record holds its sample time, and one of an earlier version holds no rise: it had none."""
    recorded = resolved("egm", frame={"follow_normal": True}, controller={"sample_ms": 4.0})
    stroke, state = tracking(travel_rise_s=recorded.config.task.travel_rise_s)
    assert travelling(stroke, state, 1)[1] == [SPEED * 1e-3 * DT]


def test_a_negative_time_is_refused() -> None:
    with pytest.raises(SettingError, match="travel_rise_s"):
        TaskParameters(travel_rise_s=-0.1)
