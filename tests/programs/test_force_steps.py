"""Steps of the desired force on a soft surface: the robot carries out each order in the time that the guard gives."""

from collections.abc import Callable
from typing import Any

import pytest

Play = Callable[..., Any]
STEPS = [
    {"do": "approach", "at_most_mm": 6.0},
    {"do": "hold", "for_s": 3.0, "force_n": 10.0},
    {"do": "hold", "for_s": 3.0, "force_n": 20.0},
    {"do": "hold", "for_s": 3.0, "force_n": 10.0},
    {"do": "retract", "back_mm": 2.0},
]
RUN = {
    "sensor": {"emulated": "netft"},
    "controller": {"name": "predictive"},
    "task": {"expected_stiffness_n_m": 5000.0},
    "cell": {"start_position_mm": (900.0, -100.0, 591.5), "surface": {"stiffness_n_m": 5000.0}},
}


@pytest.mark.parametrize(("robot", "seed"), [("egm", 2), ("rsi", 4)])
def test_step_down_is_carried_out_in_time(play: Play, robot: str, seed: int) -> None:
    """An order of 2 mm at once would be late: the servo has more than 0.3 mm left after 80 ms."""
    trial = play(robot, STEPS, RUN, {"run": {"seed": seed}})
    assert trial.result.outcome == "completed", trial.result
    settled = [record.force for record in trial.cycles if record.phase == "track"][-200:]
    assert all(9.0 < force < 11.0 for force in settled)
