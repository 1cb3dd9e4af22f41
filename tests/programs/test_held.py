"""A user holds the tool in place on the surface: the force is kept, the way does not continue, replay knows it."""

from collections.abc import Callable
from typing import Any

import pytest

Play = Callable[..., Any]
LINE = {"kind": "line", "length_mm": 40.0}
STEPS = [
    {"do": "approach"},
    {"do": "track", "path": LINE, "speed_mm_s": 10.0, "lateral_limit_n": 40.0},
    {"do": "retract"},
]
RUN = {
    "run": {"duration_s": 6.0},
    "cell": {"start_position_mm": (900.0, -100.0, 592.0)},
    "task": {"retract_mm": 5.0, "retract_speed_mm_s": 11.0},
}
HELD_S = (1.0, 4.0)
"""Begin and end of the hold after the first cycle of tracking, s; longer than a program waits for progress."""


@pytest.mark.full
@pytest.mark.parametrize("steps", [[], STEPS], ids=["plain", "program"])
@pytest.mark.parametrize("robot", ["s3", "egm"])
def test_the_force_is_kept_and_the_way_stands(play: Play, robot: str, steps: list[dict[str, Any]]) -> None:
    begins: list[float] = []
    toggles: list[float] = []

    def meddle(played: Any, record: Any) -> None:
        if record.phase != "track":
            assert played.run.hold() is False, "before the touch and on the way back there is nothing to hold"
            return
        begins.append(record.started_at)
        since = record.started_at - begins[0]
        if len(toggles) < 2 and since >= HELD_S[len(toggles)]:
            toggles.append(record.answered_at)
            assert played.run.hold() is (len(toggles) == 1)

    played = play(robot, steps, RUN, meddle=meddle)
    assert played.result.outcome == "completed", played.result
    held = [record for record in played.cycles if record.sample.held]
    assert len(held) > 10
    assert len({record.travel_commanded for record in held}) == 1
    settled = [record.force for record in held if record.started_at > toggles[0] + 1.0]
    assert settled
    assert all(9.0 < force < 11.0 for force in settled)
    ways = [record.travel_commanded for record in played.cycles if record.phase == "track"]
    assert ways[-1] > held[0].travel_commanded + 5e-3
    assert not played.differs()
