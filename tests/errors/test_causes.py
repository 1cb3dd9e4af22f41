"""The reported cause is the true one, for any failure of the robot while tracking."""

from collections.abc import Callable
from typing import Any

import pytest

from hil_bridge.record import CycleRecord, Outcome

pytestmark = pytest.mark.sweep

Bench = Any

HANDS: dict[str, tuple[Callable[[Any, float], object], str]] = {
    "power cycle": (
        lambda robot, now: robot.inject("power-cycle", now),
        "in standby, as after a restart",
    ),
    "power cycle in mid-message": (
        lambda robot, now: robot.inject("power-cycle", now, after_bytes=20),
        "in standby, as after a restart",
    ),
    "work stop": (lambda robot, now: robot.set_work_stop(True, now), "16 work stop"),
    "work stop that is over": (
        lambda robot, now: (robot.set_work_stop(True, now), robot.set_work_stop(False, now)),
        "whether something has ended the movement in between: a stop",
    ),
    "emergency stop": (
        lambda robot, now: robot.press_emergency_stop(now),
        "emergency stop, in standby",
    ),
    "emergency stop that is over": (
        lambda robot, now: (robot.press_emergency_stop(now), robot.release_emergency_stop(now)),
        "in standby, as after a restart or by hand",
    ),
    "key": (lambda robot, now: robot.set_key(False, now), "key not in AUTO"),
    "link control": (
        lambda robot, now: robot.set_link_control(False, now),
        "link control taken back",
    ),
    "damaged answers": (
        lambda robot, now: robot.inject("corrupt-block", now, count=20),
        "on the link meanwhile: bad checksum 4, NAK sent 3",
    ),
    "a break of the line": (
        lambda robot, now: robot.inject("line-break", now, for_s=5.0),
        "it answers again, and its status shows no stop",
    ),
}


@pytest.mark.parametrize("offset_ms", [0, 20, 50, 80, 110])
@pytest.mark.parametrize("hand", HANDS)
def test_cause_names_robot_failure(bench: Callable[..., Bench], hand: str, offset_ms: int) -> None:
    """The robot fails at several times of a cycle of 156 ms."""
    act, message = HANDS[hand]
    done: list[float] = []

    def meddle(run: Bench, record: CycleRecord) -> None:
        if record.phase == "track" and not done:
            done.append(run.clock.now() + 0.3 + offset_ms * 1e-3)
            run.clock.call_at(done[0], lambda: act(run.cell.robot, run.clock.now()))

    run = bench(meddle)
    assert run.result is not None
    assert run.result.outcome is Outcome.STOPPED
    assert message in run.result.text
    assert "\n" not in run.result.text


def test_silent_robot_does_not_blame_line_settings(bench: Callable[..., Bench]) -> None:
    """Each order waits for its period, so that the bid remains unanswered."""

    def silence(run: Bench, record: CycleRecord) -> None:
        if len(run.tracked()) == 3:
            run.cell.robot.inject("off", run.clock.now(), for_s=60.0)

    cause = bench(silence, run={"period_ms": 250.0}).result.text
    assert (
        "nothing received after 3 bids (ENQ); it answered before, so the line settings are correct" in cause
    )
    assert "9600 8E1" not in cause
