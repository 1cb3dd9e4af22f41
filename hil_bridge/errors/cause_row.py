"""A row of the table of causes, and the words for the parts that it blames."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from hil_bridge.errors.causes import Cause, Part


class When(StrEnum):
    """When a condition is looked at."""

    BEFORE_MOTION = "before anything moves"
    LIFT = "on the way to the zero"
    CYCLE = "every cycle until the retraction"
    RETRACTION = "every cycle of the retraction"
    ALWAYS = "as long as the tool moves"
    END = "at the end"
    READING = "when the recording is read"


class Reaction(StrEnum):
    """Consequence of a condition."""

    REFUSED = "refused, nothing has moved"
    CLAMPED = "less is ordered, the run continues"
    RETRACTS = "retracts and ends"
    STANDS = "stands still and ends"
    LEFT = "left where it is"
    RETRACTS_OR_LEFT = "retracts once the robot takes orders; else left where it is"


COMPLETED, CONFIGURATION, STOPPED, CRITERION, INTERRUPTED = 0, 2, 3, 4, 130
"""Exit codes. 4: the run has completed, but a step of its program did not meet its criterion. 130 is what a shell
expects of a command that Ctrl-C ended.
"""

PART_WORDS: Mapping[Part, str] = {
    Part.ROBOT: "the robot{robot}",
    Part.ROBOT_LINK: "the link to the robot{robot}",
    Part.POSE: "the position that the robot{robot} reports",
    Part.SENSOR: "the force sensor{sensor}",
    Part.CONTACT: "the contact, since the robot{robot} went too deep, the surface is another, or the force "
    "sensor{sensor} tells it wrongly",
    Part.SURFACE: "the surface, or the force sensor{sensor} that does not feel it",
    Part.OBSTACLE: "what the tool touches, or the force sensor{sensor}",
    Part.PATH: "the path",
    Part.CONTROLLER: "the controller",
    Part.OTHERS_CODE: "plug-in code",
    Part.CELL: "the emulated cell, not a device",
    Part.COMPUTER: "the computer that runs the bridge, or the controller",
    Part.PROGRAM: "the program itself",
    Part.CONFIGURATION: "the configuration",
    Part.PERSON: "an operator",
    Part.TASK: "its task",
}
"""Each part in words; the kinds of robot and sensor are put in where they are known."""

_PROBE = "`hil-bridge probe sensor URL` checks "
_MONITOR = "`hil-bridge monitor {recording}` shows the traffic"
LOOK: Mapping[Part, str] = {
    Part.ROBOT: "the robot's panel and its status in the events",
    Part.ROBOT_LINK: f"the robot's cable, its supply and its program; {_MONITOR}",
    Part.POSE: "where the tool really is, and what the robot's display shows",
    Part.SENSOR: f"the sensor's cable and supply; {_PROBE}its stream",
    Part.CONTACT: "the force before the stop in the report: one frame that jumps is the sensor, a ramp is a touch",
    Part.SURFACE: "where the tool stands above the surface, and whether the sensor's sign is right",
    Part.OBSTACLE: "what is above or beside the tool, then the sensor's signal in the report",
    Part.PATH: "limits.workspace_min_m and limits.workspace_max_m of the configuration, and the start of the run",
    Part.CONTROLLER: "the controller's own code and parameters",
    Part.OTHERS_CODE: "the traceback below, which stands in the recording's events",
    Part.CELL: "the traceback below, which stands in the recording's events",
    Part.COMPUTER: "what else runs on that computer, and [realtime] of the configuration",
    Part.PROGRAM: "the recording, which shows the orders before; report it with the bug",
    Part.CONFIGURATION: "the configuration",
    Part.PERSON: "the events of the recording",
    Part.TASK: "the configuration of the task",
}
"""Where to look first for each part."""


@dataclass(frozen=True, slots=True)
class CauseRow:
    """One cause, what rules it, and its consequence."""

    cause: Cause
    condition: str
    """Condition in words."""
    settings: tuple[str, ...]
    """Keys of the configuration that rule it, without those that describe a device."""
    part: Part
    when: When = When.CYCLE
    reaction: Reaction = Reaction.RETRACTS
    exit_code: int | None = STOPPED
    """None where the run continues."""
    words: str = ""
    """Words for the part at fault, where those of the part alone do not say it."""
    where: str = ""
    """Where to look where that is not what its part tells."""

    @property
    def blames(self) -> str:
        """Words for the part at fault, with places for the kinds of robot and sensor."""
        return self.words or PART_WORDS[self.part]

    @property
    def look(self) -> str:
        """Where an operator looks first, in words."""
        return self.where or LOOK[self.part]


SENSOR_OR_TOUCH = "the force sensor{sensor}, or what the tool touches"
"""Words for sensor and touch, where either can be at fault."""
FREELY = f"whether the tool touches anything now; {_PROBE}the sensor"
"""Where to look then."""
WORKSPACE = "limits.workspace_min_m", "limits.workspace_max_m"


def stop(cause: Cause, condition: str, part: Part, *settings: str, **more: Any) -> CauseRow:
    """Return a row of a cause that retracts and ends."""
    return CauseRow(cause, condition, settings, part, **more)
