"""Scenarios for robot clients, and the rules by which they are judged."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from hil_bridge.lab.conform.trial import CUT, NOMINAL
from protocol.marks import Mark, above, at_least, between, check_settings, setting

MOVED_M = 0.5e-3
"""Smallest distance from the start at which a tool counts as moved, m. Chosen: above noise and rounding of any
robot.
"""
MOVED_RAD = 5e-3
"""Smallest rotation from the start at which a tool counts as moved, rad. Chosen: above noise and rounding of any
robot. It is needed because a client that turns only the last joint moves no point on the tool's axis.
"""
SAME_PLACE_M = 1e-5
"""Largest distance at which two orders lead to the same position, m. Chosen: the orders of a client that holds its
position are that close.
"""
SAME_TURN_RAD = 1e-4
"""Largest angle at which two orders lead to the same orientation, rad. Chosen: a quaternion with a resolution of
1/16384 is as coarse.
"""
STILL_M = 0.05e-3
"""Largest motion within `STILL_S` of a tool that counts as stationary, m. Chosen."""
STILL_RAD = 1e-3
"""Largest rotation within `STILL_S` of a tool that counts as stationary, rad. Chosen."""
STILL_S = 0.2
"""Time for which a tool must be stationary, s. Chosen."""

LATE, REFUSED, STOPPED, EMERGENCY = "late", "refused", "stopped", "emergency"
SCENARIOS: Mapping[str, str] = {
    NOMINAL: "no fault",
    LATE: "the robot's messages are delayed once the tool moves",
    REFUSED: "the robot may not move from the start",
    STOPPED: "the robot stops and reports it while the tool moves",
    EMERGENCY: "the emergency stop is pressed while the tool moves",
    CUT: "the link is cut while the tool moves, and restored",
}
"""Description of each scenario, in the order of execution."""


@dataclass(frozen=True, slots=True)
class Rules:
    """Durations of the parts of a scenario, and requirements that a client must meet."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    start_s: float = setting(
        10.0,
        Mark.CHOSEN,
        "time in which the tool of a new client must move",
        above(0.0, 600.0),
        unit="s",
    )
    after_s: float = setting(0.5, Mark.CHOSEN, "time from then to the fault", between(0.0, 600.0), unit="s")
    watch_s: float = setting(
        2.0,
        Mark.CHOSEN,
        "observation time after a fault",
        above(0.0, 600.0),
        unit="s",
    )
    run_s: float = setting(
        10.0,
        Mark.CHOSEN,
        "duration of motion in `nominal` before the request to terminate",
        above(0.0),
        unit="s",
    )
    react_s: float = setting(0.5, Mark.CHOSEN, "time to react to a stop", between(0.0, 60.0), unit="s")
    cut_s: float = setting(1.0, Mark.CHOSEN, "duration of the cut", above(0.0, 60.0), unit="s")
    back_s: float = setting(5.0, Mark.CHOSEN, "time to reconnect after a cut", above(0.0, 600.0), unit="s")
    end_s: float = setting(3.0, Mark.CHOSEN, "time to terminate on request", above(0.0, 600.0), unit="s")
    stand_s: float = setting(
        2.0, Mark.CHOSEN, "time in which the tool must stop after its end", above(0.0, 60.0), unit="s"
    )
    max_speed_mm_s: float = setting(
        0.0,
        Mark.CHOSEN,
        "largest actual and ordered speed of the tool; 0 for the robot's own limits",
        at_least(0.0),
        unit="mm/s",
    )
    max_step_mm: float = setting(
        0.0,
        Mark.CHOSEN,
        "largest step between two orders; 0 for the robot's motion in one cycle",
        at_least(0.0),
        unit="mm",
    )
    max_turn_deg: float = setting(
        0.0,
        Mark.CHOSEN,
        "largest rotation between two orders; 0 for the robot's own",
        at_least(0.0),
        unit="°",
    )
    pause_s: float = setting(
        0.05,
        Mark.CHOSEN,
        "pause attributed to this computer; after it a step consistent with the client's speed is no leap",
        between(0.0, 10.0),
        unit="s",
    )
    speed_up_s: float = setting(
        0.05,
        Mark.CHOSEN,
        "shortest time in which a path may reach the robot's top speed; 0: not judged",
        between(0.0, 10.0),
        unit="s",
    )
    breaches_percent: float = setting(
        10.0,
        Mark.CHOSEN,
        "share of orders in `nominal` that may violate the protocol, such as late answers of a busy computer",
        between(0.0, 100.0),
        unit="%",
    )
    comes_back: bool = setting(False, Mark.CHOSEN, "the client reconnects after a cut")
    ends: bool = setting(False, Mark.CHOSEN, "the client ends by itself")

    def __post_init__(self) -> None:
        check_settings(self)
