"""Gradual rise of the travel speed, so that an unknown slope shows before the tool moves fast."""

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
    """Controller that never moves."""

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
    """Return the state after some samples of tracking, and the distance of each, m."""
    travels = []
    measurement = Measurement(0.0, more.pop("force", FORCE), 0.0, 0.0, dt=more.pop("dt", DT), **more)
    for _ in range(samples):
        before = state.travel
        state, _ = stroke.step(state, measurement, stride or Stride(FORCE))
        travels.append(state.travel - before)
    return state, travels


def first(samples: int, dt: float = DT) -> list[float]:
    """Return the distance of each of the first samples of a travel, m."""
    return [min(k * dt / RISE, 1.0) * SPEED * 1e-3 * dt for k in range(1, samples + 1)]


@pytest.mark.parametrize("dt", [0.002, 0.004, 0.012, 0.05, 0.179])
def test_travel_speed_rises_linearly(dt: float) -> None:
    samples = round(1.5 * RISE / dt)
    _, travels = travelling(*tracking(), samples, dt=dt)
    assert travels == pytest.approx(first(samples, dt), rel=1e-9, abs=1e-15)


def test_travel_rise_starts_when_force_allows_travel() -> None:
    stroke, state = tracking(travel_from_share=0.8)
    state, travels = travelling(stroke, state, 1, force=7.9)
    assert travels == [0.0]
    _, travels = travelling(stroke, replace(state, settled=False), 3, force=8.0)
    assert travels == pytest.approx(first(3))


@pytest.mark.parametrize("dt", [0.0, 0.004, 0.18])
def test_travel_without_rise_starts_at_full_speed(dt: float) -> None:
    stroke, state = tracking(travel_rise_s=0.0)
    assert travelling(stroke, state, 1, dt=dt)[1] == [stroke.way(SPEED, dt)]


def test_travel_rise_ignores_sample_without_duration() -> None:
    stroke, state = tracking()
    state, _ = travelling(stroke, state, 10)
    after, travels = travelling(stroke, state, 1, dt=0.0)
    assert travels == [0.0]
    assert after.speed_mm_s == state.speed_mm_s > 0.0


@pytest.mark.parametrize(("advance", "feed"), [(0.0, 1.0), (1.0, 0.0), (1.0, -0.5)])
def test_travel_rise_restarts_after_stop_or_reversal(advance: float, feed: float) -> None:
    stroke, state = tracking()
    state, _ = travelling(stroke, state, 400)
    assert state.speed_mm_s == SPEED
    state, travels = travelling(stroke, state, 1, Stride(FORCE, feed), advance=advance)
    assert travels == pytest.approx([feed * advance * SPEED * 1e-3 * DT])
    assert travelling(stroke, state, 3)[1] == pytest.approx(first(3))


def test_travel_rise_restarts_after_contact_loss() -> None:
    stroke, state = tracking()
    fast, _ = travelling(stroke, state, 400)
    lost, travels = travelling(stroke, fast, 1, force=0.0)
    assert travels == [0.0]
    assert travelling(stroke, lost, 3)[1] == pytest.approx(first(3))
    assert travelling(stroke, stroke.tracking(replace(fast, phase=Phase.APPROACH)), 3)[1] == pytest.approx(
        first(3)
    )
    on = stroke.tracking(fast)  # another step of the same touch
    assert travelling(stroke, on, 1)[1] == pytest.approx([SPEED * 1e-3 * DT])


def test_travel_rise_slow_sample_costs_only_its_distance() -> None:
    stroke, state = tracking()
    state, _ = travelling(stroke, state, 400)
    state, slow = travelling(stroke, state, 1, Stride(FORCE, 0.5))
    assert slow == pytest.approx([0.5 * SPEED * 1e-3 * DT])
    assert travelling(stroke, state, 1)[1] == pytest.approx([SPEED * 1e-3 * DT])


def resolved(robot: str, **sections: dict[str, Any]) -> Setup:
    devices = {"robot": {"emulated": robot}, "sensor": {"emulated": "jr3" if robot == "s3" else "netft"}}
    return Setup(read_config({**devices, **sections}))


@pytest.mark.parametrize(
    ("robot", "follows", "configured", "rise"),
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
def test_travel_rise_default_is_recorded(
    robot: str, follows: bool, configured: float | None, rise: float | None
) -> None:
    task = {} if configured is None else {"travel_rise_s": configured}
    setup = resolved(robot, frame={"follow_normal": follows}, task=task)
    assert setup.config.task.travel_rise_s == rise
    assert setup.loop.program.parameters.travel_rise_s == rise


def test_travel_rise_old_recording_replays_unchanged() -> None:
    """A recording contains its sample time; one of an earlier version contains no rise, because there was none."""
    recorded = resolved("egm", frame={"follow_normal": True}, controller={"sample_ms": 4.0})
    stroke, state = tracking(travel_rise_s=recorded.config.task.travel_rise_s)
    assert travelling(stroke, state, 1)[1] == [SPEED * 1e-3 * DT]


def test_travel_rise_negative_time_is_refused() -> None:
    with pytest.raises(SettingError, match="travel_rise_s"):
        TaskParameters(travel_rise_s=-0.1)
