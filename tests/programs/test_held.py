"""A user holds the tool in position on the surface: the force is kept, the travel stops, and a replay reproduces it."""

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
"""Start and end of the hold after the first cycle of tracking, s; longer than a program waits for progress."""


@pytest.mark.full
@pytest.mark.parametrize("steps", [[], STEPS], ids=["plain", "program"])
@pytest.mark.parametrize("robot", ["s3", "egm"])
def test_hold_keeps_force_and_stops_travel(play: Play, robot: str, steps: list[dict[str, Any]]) -> None:
    starts: list[float] = []
    toggles: list[float] = []

    def meddle(trial: Any, record: Any) -> None:
        if record.phase != "track":
            assert trial.run.hold() is False, "no hold before the touch or during the retraction"
            return
        starts.append(record.started_at)
        since = record.started_at - starts[0]
        if len(toggles) < 2 and since >= HELD_S[len(toggles)]:
            toggles.append(record.answered_at)
            assert trial.run.hold() is (len(toggles) == 1)

    trial = play(robot, steps, RUN, meddle=meddle)
    assert trial.result.outcome == "completed", trial.result
    paused = [record for record in trial.cycles if record.sample.held]
    assert len(paused) > 10
    assert len({record.travel_commanded for record in paused}) == 1
    steady = [record.force for record in paused if record.started_at > toggles[0] + 1.0]
    assert steady
    assert all(9.0 < force < 11.0 for force in steady)
    travels = [record.travel_commanded for record in trial.cycles if record.phase == "track"]
    assert travels[-1] > paused[0].travel_commanded + 5e-3
    assert not trial.differs()
