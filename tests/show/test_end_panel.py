"""Sentences about the end of a run, as a report and the page of a run show them."""

import pytest

from hil_bridge.errors.causes import Cause, Reason
from hil_bridge.record.ending import Outcome, RunEnd
from hil_bridge.show.charts.end_panel import end_panel

REASON = Reason(
    Cause.ROBOT_STATE, "the motors are off", "switch the motors on", facts="its status is: stopped"
)
LEFT = {
    "left": "NOT retracted",
    "place": "left at 3.5 mm, 10.1 N",
    "rest": {"retracted": False, "force_n": 10.1},
}


def test_pressing_tool_is_stated_before_next_step() -> None:
    panel = end_panel(RunEnd(Outcome.STOPPED, REASON, **LEFT), (), "stopped after 2 s", lift=True)  # type: ignore[arg-type]
    texts = [(line.text.replace("\u00a0", " "), line.style) for line in panel.lines]
    assert texts == [
        ("The motors are off.", "lead"),
        ("Its status is: stopped.", ""),
        ("The tool was left at 3.5 mm, 10.1 N measured; `hil-bridge free` lifts it off.", "alarm"),
        ("Next: switch the motors on.", "todo"),
        ("Stopped after 2 s; cause: robot-state.", "quiet"),
    ]


@pytest.mark.parametrize(
    ("outcome", "cause", "tool"),
    [
        (Outcome.STOPPED, Cause.ROBOT_STATE, "No position of the tool was recorded."),
        (Outcome.INTERRUPTED, Cause.CUT, "It is unknown where the tool is."),
    ],
)
def test_missing_position_is_no_claim_of_rest(outcome: Outcome, cause: Cause, tool: str) -> None:
    panel = end_panel(RunEnd(outcome, Reason(cause, "a fact")), (), "")
    assert tool in [line.text for line in panel.lines]
