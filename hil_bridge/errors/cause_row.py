"""Rows of the table of causes, and descriptions of the parts at fault."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from hil_bridge.errors.causes import Cause, Part


class When(StrEnum):
    """Time at which a condition is checked."""

    BEFORE_MOTION = "before anything moves"
    LIFT = "on the way to the zero"
    CYCLE = "every cycle until the retraction"
    RETRACTION = "every cycle of the retraction"
    ALWAYS = "as long as the tool moves"
    END = "at the end"
    READING = "when the recording is read"


class Reaction(StrEnum):
    """Reaction of a run to a condition."""

    REFUSED = "refused, nothing has moved"
    CLAMPED = "less is ordered, the run continues"
    RETRACTS = "retracts and ends"
    STANDS = "stands still and ends"
    LEFT = "left where it is"
    RETRACTS_OR_LEFT = "retracts once the robot takes orders; else left where it is"


COMPLETED, CONFIGURATION, STOPPED, CRITERION, INTERRUPTED = 0, 2, 3, 4, 130
"""Exit codes. 4: the run has completed, but a step of its program did not meet its criterion. 130 is the code that
a shell expects from a command that Ctrl-C ended.
"""

PART_DESCRIPTIONS: Mapping[Part, str] = {
    Part.ROBOT: "the robot{robot}",
    Part.ROBOT_LINK: "the link to the robot{robot}",
    Part.POSE: "the position that the robot{robot} reports",
    Part.SENSOR: "the force sensor{sensor}",
    Part.CONTACT: "the contact: the robot{robot} went too deep, the surface differs, or the force "
    "sensor{sensor} reads wrong",
    Part.SURFACE: "the surface, or the force sensor{sensor} that does not measure it",
    Part.OBSTACLE: "what the tool touches, or the force sensor{sensor}",
    Part.PATH: "the path",
    Part.CONTROLLER: "the controller",
    Part.PLUGIN_CODE: "plug-in code",
    Part.CELL: "the emulated cell, not a device",
    Part.COMPUTER: "the computer that runs the bridge, or the controller",
    Part.PROGRAM: "the program itself",
    Part.CONFIGURATION: "the configuration",
    Part.PERSON: "an operator",
    Part.TASK: "its task",
}
"""Description of each part, with placeholders for the kinds of robot and sensor."""

_PROBE = "`hil-bridge probe sensor URL` checks "
_MONITOR = "`hil-bridge monitor {recording}` shows the traffic"
LOOK: Mapping[Part, str] = {
    Part.ROBOT: "the robot's panel and its status in the events",
    Part.ROBOT_LINK: f"the robot's cable, its supply and its program; {_MONITOR}",
    Part.POSE: "the true position of the tool, and the robot's display",
    Part.SENSOR: f"the sensor's cable and supply; {_PROBE}its stream",
    Part.CONTACT: "the force before the stop in the report: a jump in one frame is the sensor, "
    "a ramp a contact",
    Part.SURFACE: "the position of the tool above the surface, and the sign of the sensor's forces",
    Part.OBSTACLE: "anything above or next to the tool, then the sensor's signal in the report",
    Part.PATH: "limits.workspace_min_m and limits.workspace_max_m of the configuration, and the start of the run",
    Part.CONTROLLER: "the controller's own code and parameters",
    Part.PLUGIN_CODE: "the traceback below, which is also in the recording's events",
    Part.CELL: "the traceback below, which is also in the recording's events",
    Part.COMPUTER: "what else runs on that computer, and [realtime] of the configuration",
    Part.PROGRAM: "the recording, which shows the preceding orders; attach it to the bug report",
    Part.CONFIGURATION: "the configuration",
    Part.PERSON: "the events of the recording",
    Part.TASK: "the configuration of the task",
}
"""First check for the operator, by part."""


@dataclass(frozen=True, slots=True)
class CauseRow:
    """Cause with its condition, settings and reaction."""

    cause: Cause
    condition: str
    """Description of the condition that the row is about."""
    settings: tuple[str, ...]
    """Configuration keys that affect the condition, except keys that describe a device."""
    part: Part
    when: When = When.CYCLE
    reaction: Reaction = Reaction.RETRACTS
    exit_code: int | None = STOPPED
    """Exit code; None if the run continues."""
    words: str = ""
    """Description of the part at fault; empty to use the part's own description."""
    where: str = ""
    """First check for the operator; empty to use the part's default."""

    @property
    def blames(self) -> str:
        """Description of the part at fault, with placeholders for the kinds of robot and sensor."""
        return self.words or PART_DESCRIPTIONS[self.part]

    @property
    def look(self) -> str:
        """First check for the operator."""
        return self.where or LOOK[self.part]


SENSOR_OR_TOUCH = "the force sensor{sensor}, or what the tool touches"
"""Description of the part at fault if it is either the sensor or a contact."""
FREELY = f"whether the tool touches anything now; {_PROBE}the sensor"
"""First check for the operator if the part at fault is either the sensor or a contact."""
WORKSPACE = "limits.workspace_min_m", "limits.workspace_max_m"


def stop(cause: Cause, condition: str, part: Part, *settings: str, **more: Any) -> CauseRow:
    """Return the row for a cause that makes the tool retract and ends the run."""
    return CauseRow(cause, condition, settings, part, **more)
