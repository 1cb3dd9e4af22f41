"""The scenarios that a robot's client is put through, and the rules by which it is judged."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from hil_bridge.lab.conform.trial import CUT, NOMINAL
from protocol.marks import Mark, above, at_least, between, check_settings, setting

MOVED_M = 0.5e-3
"""Chosen: a tool that is so far from its start has moved; noise and rounding of any robot are below."""
MOVED_RAD = 5e-3
"""Chosen: the same of its turn. A client that turns the last joint alone moves no point on the tool's axis."""
SAME_PLACE_M = 1e-5
"""Chosen: two orders nearer than this lead to the same place, as those of a client that holds."""
SAME_TURN_RAD = 1e-4
"""Chosen: the same of their turn; a quaternion of 1/16384 steps is as coarse."""
STILL_M = 0.05e-3
"""Chosen: a tool that moves by less in `STILL_S` stands."""
STILL_RAD = 1e-3
"""Chosen: the same of its turn."""
STILL_S = 0.2
"""Chosen: for how long it has to stand."""

LATE, REFUSED, STOPPED, EMERGENCY = "late", "refused", "stopped", "emergency"
SCENARIOS: Mapping[str, str] = {
    NOMINAL: "nothing is wrong",
    LATE: "what the robot says comes late, once the tool moves",
    REFUSED: "the robot may not move, from the start",
    STOPPED: "the robot stops and says so, while the tool moves",
    EMERGENCY: "its emergency stop is pressed, while the tool moves",
    CUT: "the wire is cut while the tool moves, and comes back",
}
"""In the order in which they are played."""


@dataclass(frozen=True, slots=True)
class Rules:
    """How long each part of a scenario takes, and what is asked of a client."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    start_s: float = setting(
        10.0,
        Mark.CHOSEN,
        "until the tool of a new client must have moved",
        above(0.0, 600.0),
        unit="s",
    )
    after_s: float = setting(0.5, Mark.CHOSEN, "from then to the fault", between(0.0, 600.0), unit="s")
    watch_s: float = setting(
        2.0,
        Mark.CHOSEN,
        "for how long a client is watched behind a fault",
        above(0.0, 600.0),
        unit="s",
    )
    run_s: float = setting(
        10.0, Mark.CHOSEN, "how long it may move in `nominal`, then it is told to end", above(0.0), unit="s"
    )
    react_s: float = setting(
        0.5, Mark.CHOSEN, "in which it must have seen a stop", between(0.0, 60.0), unit="s"
    )
    cut_s: float = setting(1.0, Mark.CHOSEN, "for how long the wire is cut", above(0.0, 60.0), unit="s")
    back_s: float = setting(
        5.0, Mark.CHOSEN, "in which it must come back behind a cut", above(0.0, 600.0), unit="s"
    )
    end_s: float = setting(
        3.0, Mark.CHOSEN, "in which it must end when it is told to", above(0.0, 600.0), unit="s"
    )
    stand_s: float = setting(
        2.0, Mark.CHOSEN, "in which the tool must stand when it has ended", above(0.0, 60.0), unit="s"
    )
    max_speed_mm_s: float = setting(
        0.0,
        Mark.CHOSEN,
        "fastest that the tool may go, and be ordered to go; 0 for the robot's own limits",
        at_least(0.0),
        unit="mm/s",
    )
    max_step_mm: float = setting(
        0.0,
        Mark.CHOSEN,
        "farthest from one order to the next; 0 for what the robot goes in one cycle",
        at_least(0.0),
        unit="mm",
    )
    max_turn_deg: float = setting(
        0.0, Mark.CHOSEN, "the same of the turn between two orders", at_least(0.0), unit="°"
    )
    pause_s: float = setting(
        0.05,
        Mark.CHOSEN,
        "a pause that may be this computer's: behind it a step that the client's own speed explains is no leap",
        between(0.0, 10.0),
        unit="s",
    )
    speed_up_s: float = setting(
        0.05,
        Mark.CHOSEN,
        "a tool that gains the robot's fastest speed in less than this was driven by no path; 0: not judged",
        between(0.0, 10.0),
        unit="s",
    )
    breaches_percent: float = setting(
        10.0,
        Mark.CHOSEN,
        "share of orders in `nominal` that may break a rule of the wire, as late answers of a busy computer do",
        between(0.0, 100.0),
        unit="%",
    )
    comes_back: bool = setting(False, Mark.CHOSEN, "the client declares that it comes back behind a cut")
    ends: bool = setting(False, Mark.CHOSEN, "the client declares that it ends by itself")

    def __post_init__(self) -> None:
        check_settings(self)
