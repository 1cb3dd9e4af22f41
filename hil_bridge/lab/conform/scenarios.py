"""The scenarios that a client is put through, and the rules by which it is judged."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from protocol.marks import Mark, check_settings, setting

SUITE_VERSION = 1
"""Grows when a client that passed may fail: to be compared by those who pin it."""
MOVED_M = 0.5e-3
"""Chosen: a tool that is so far from its start has moved; noise and rounding of any robot are below."""
SAME_PLACE_M = 1e-5
"""Chosen: two orders nearer than this lead to the same place, as those of a client that holds."""
STILL_M = 0.05e-3
"""Chosen: a tool that moves by less in `STILL_S` stands."""
STILL_S = 0.2
"""Chosen: for how long it has to stand."""

NOMINAL, LATE, REFUSED, STOPPED, EMERGENCY, CUT = (
    "nominal",
    "late",
    "refused",
    "stopped",
    "emergency",
    "cut",
)
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
        unit="s",
        above=0.0,
        maximum=600.0,
    )
    after_s: float = setting(0.5, Mark.CHOSEN, "from then to the fault", unit="s", minimum=0.0, maximum=600.0)
    watch_s: float = setting(
        2.0,
        Mark.CHOSEN,
        "for how long a client is watched behind a fault",
        unit="s",
        above=0.0,
        maximum=600.0,
    )
    run_s: float = setting(
        10.0, Mark.CHOSEN, "how long it may move in `nominal`, then it is told to end", unit="s", above=0.0
    )
    react_s: float = setting(
        0.5, Mark.CHOSEN, "in which it must have seen a stop", unit="s", minimum=0.0, maximum=60.0
    )
    cut_s: float = setting(
        1.0, Mark.CHOSEN, "for how long the wire is cut", unit="s", above=0.0, maximum=60.0
    )
    back_s: float = setting(
        5.0, Mark.CHOSEN, "in which it must come back behind a cut", unit="s", above=0.0, maximum=600.0
    )
    end_s: float = setting(
        3.0, Mark.CHOSEN, "in which it must end when it is told to", unit="s", above=0.0, maximum=600.0
    )
    stand_s: float = setting(
        2.0, Mark.CHOSEN, "in which the tool must stand when it has ended", unit="s", above=0.0, maximum=60.0
    )
    max_speed_mm_s: float = setting(
        0.0,
        Mark.CHOSEN,
        "fastest that the tool may go; 0 for the robot's own limits",
        unit="mm/s",
        minimum=0.0,
    )
    max_step_mm: float = setting(
        0.0, Mark.CHOSEN, "farthest from one order to the next; 0 for any", unit="mm", minimum=0.0
    )
    comes_back: bool = setting(False, Mark.CHOSEN, "the client declares that it comes back behind a cut")
    ends: bool = setting(False, Mark.CHOSEN, "the client declares that it ends by itself")

    def __post_init__(self) -> None:
        check_settings(self)
