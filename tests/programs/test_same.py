"""The paper's run, written as a program, gives the same commands in every cycle."""

from collections.abc import Callable
from typing import Any

import pytest

pytestmark = pytest.mark.sweep

Trial = Any
Play = Callable[..., Trial]
PATH = {"kind": "line", "length_mm": 500.0}
PAPER = [{"do": "approach"}, {"do": "track", "path": PATH, "for_s": 3.0}, {"do": "retract"}]
RUN = {
    "run": {"duration_s": 3.0},
    "cell": {"start_position_mm": (900.0, -100.0, 592.0)},
    "task": {"retract_mm": 5.0, "retract_speed_mm_s": 11.0},
}


@pytest.mark.parametrize("robot", ["s3", "egm", "rtde", "rsi"])
def test_program_and_plain_run_have_same_commands(play: Play, robot: str) -> None:
    plain, program = play(robot, [], RUN), play(robot, PAPER, RUN)
    assert plain.result.outcome == program.result.outcome == "completed"
    assert [commands(record) for record in plain.cycles] == [commands(record) for record in program.cycles]
    assert sum(record.phase == "track" for record in plain.cycles) > 15
    assert plain.result.left == program.result.left == "retracted, 0.0 N"


def commands(record: Any) -> tuple[object, ...]:
    """Return all orders of the run in a cycle, with the reasons. A program gives the orientation of the start where a
    plain run gives none.
    """
    assert record.quaternion_commanded in ((), record.sample.quaternion)
    return (
        record.cycle,
        record.started_at,
        record.phase,
        record.depth_commanded,
        record.travel_commanded,
        record.across_commanded,
        record.target,
        record.verdict,
        record.reasons,
        record.force,
        record.force_reference,
    )
