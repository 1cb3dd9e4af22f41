"""Faults that end a run in contact, started by the command like an operator does, in virtual time.

`tests/live/test_ways_out_live.py` ends runs of another process over real wires; what a signal does is held in
`test_process_edges.py` and `tests/runs/test_signals_and_screens.py`.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from emulators.cell import Cell
from hil_bridge.record import read
from hil_bridge.runs import compose

LATER_S = 60.0
"""Time after which an arm with a late answer is stationary, s."""
CONFIG = """
[task]
retract_mm = 3.0
[limits]
cycle_deadline_ms = 5000.0
stale_after_ms = 1500.0
retract_patience_s = 2.0
[cell]
start_position_mm = [900.0, -100.0, 592.0]
[[faults]]
phase = "track"
after_s = 1.5
"""


class Ending(NamedTuple):
    """Fault, and the promised result of the command."""

    fault: str
    left: str
    """Start of the last line."""
    presses: bool
    """The tool is left on the surface."""
    cause: str
    """Part of the error message."""


RETRACTED, NOT = "left: retracted, ", "left: NOT retracted: left at "
ENDINGS: dict[str, Ending] = {
    "refused move": Ending(
        'on = "robot"\nfault = "refuses"\nwith = { function = 24 }', RETRACTED, False, "refused order 24: 31"
    ),
    "emergency stop": Ending('on = "robot"\nfault = "emergency-stop"', NOT, True, "emergency stop"),
    "dead link": Ending('on = "wire"\nfault = "off"\nfor_s = 600.0', NOT, True, "robot on memory:robot"),
    "late answer": Ending(
        'on = "robot"\nfault = "late-answer"\nwith = { seconds = 12.0 }', RETRACTED, False, "no answer"
    ),
    "silent sensor": Ending('on = "sensor-wire"\nfault = "off"\nfor_s = 600.0', NOT, False, "no new force"),
}


@pytest.fixture
def cells(monkeypatch: pytest.MonkeyPatch) -> list[Cell[Any, Any]]:
    """The cells that are made from now on."""
    made: list[Cell[Any, Any]] = []
    make = compose.make_cell

    def keep(*arguments: Any) -> Cell[Any, Any]:
        made.append(make(*arguments))
        return made[-1]

    monkeypatch.setattr(compose, "make_cell", keep)
    return made


@pytest.mark.full
@pytest.mark.parametrize("name", ENDINGS)
def test_every_ending_meets_its_guarantees(
    hil: Callable[..., tuple[int, str, str]], cells: list[Cell[Any, Any]], name: str
) -> None:
    case = ENDINGS[name]
    Path("c.toml").write_text(CONFIG + case.fault)
    arguments = ("--virtual", "--duration", "60", "--no-view", "--record", "r.mcap")
    code, output, errors = hil("run", "c.toml", *arguments)
    recording = read(Path("r.mcap"))
    assert (code, recording.end["outcome"]) == (3, "stopped")
    assert output.splitlines()[-1].startswith(case.left)
    assert case.cause in errors
    assert errors.count("\n") == 1
    assert max(truth.force[2] for truth in recording.truths) > 8.0
    force = cells[-1].true_state(recording.truths[-1].at + LATER_S).contact_force[2]
    assert force > 3.0 if case.presses else force == 0.0
