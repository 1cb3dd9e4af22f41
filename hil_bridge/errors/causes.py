"""Causes why a run is refused, clamped, stopped or ended, and the part of a cell that is at fault.

A cause is passed on as a value, along with its message, from its origin to the page. `cause_table` has a row for
each cause: condition, settings, reaction, exit code and what to check.
"""

from enum import StrEnum

from msgspec import Struct, structs


class Part(StrEnum):
    """Part at fault: a part of a cell, of its surroundings or of the program."""

    ROBOT = "robot"
    ROBOT_LINK = "robot-link"
    POSE = "pose"
    """Position and orientation that the robot reports."""
    SENSOR = "sensor"
    CONTACT = "contact"
    """Contact between tool and surface."""
    SURFACE = "surface"
    OBSTACLE = "obstacle"
    """Object next to or behind the tool."""
    PATH = "path"
    """Path that the configuration specifies."""
    CONTROLLER = "controller"
    PLUGIN_CODE = "code-of-others"
    """Code of a plug-in."""
    CELL = "cell"
    """Emulated cell, apart from the devices that it emulates."""
    COMPUTER = "computer"
    PROGRAM = "program"
    """This program."""
    CONFIGURATION = "configuration"
    PERSON = "person"
    TASK = "task"
    """Task itself, which is complete."""


class Cause(StrEnum):
    """Cause why a run is refused, clamped, stopped or ended."""

    # --- before anything moves
    CONFIGURATION = "configuration"
    UNKNOWN_TOOL = "unknown-tool"
    START = "start"
    START_TURNED = "start-turned"
    ROBOT_NOT_READY = "robot-not-ready"
    STREAM = "stream"
    UNSTEADY = "unsteady"
    WEIGHT = "weight"
    UNVERIFIED_AXIS = "unverified-axis"
    MOVED_BEFORE = "moved-before"
    # --- on the way to the zero
    TOUCHING = "touching"
    LIFT_FOLLOW = "follow"
    LIFT_STATE = "lift-state"
    ZERO = "zero"
    ZERO_CHANGED = "zero-changed"
    ZERO_SILENT = "zero-silent"
    # --- the guard, in every cycle
    FORCE_NOT_A_NUMBER = "force-not-a-number"
    POSE_NOT_A_NUMBER = "pose-not-a-number"
    COMMAND_NOT_A_NUMBER = "command-not-a-number"
    ROBOT_STATE = "robot-state"
    ORIENTATION = "orientation"
    SENSOR_FAILED = "sensor-failed"
    FORCE = "force"
    RESULTANT_FORCE = "resultant-force"
    MOMENT = "moment"
    WALL = "wall"
    SATURATED = "saturated"
    PULL = "pull"
    FORCE_TOO_OLD = "force-too-old"
    SAME_COUNTS = "same-counts"
    """Frames arrive, but their counts are identical."""
    NO_NEW_FRAME = "no-new-frame"
    """No new frames arrive."""
    DEAD_AXIS = "dead-axis"
    JUMP = "jump"
    FOLLOWING = "following"
    TILT = "tilt"
    OUTSIDE = "outside"
    UNANSWERED = "unanswered"
    SEQUENCE = "sequence"
    DEADLINE = "deadline"
    INCONSISTENT = "inconsistent"
    WITNESS = "witness"
    LOST_WEIGHT = "lost-weight"
    UNCHANGED = "unchanged"
    CONTROLLER = "controller"
    STEP_CODE = "step-code"
    STEP_TROUBLE = "step-trouble"
    OSCILLATION = "oscillation"
    OFF_PATH = "off-path"
    # --- the guard, while the tool retracts
    BEHIND = "behind"
    RETRACT_OVER = "retract-over"
    RETRACT_RISE = "retract-rise"
    RETRACT_STAYS = "retract-stays"
    # --- the guard holds an order back
    BARRIER = "barrier"
    OVERDUE = "overdue"
    DEEPER = "deeper"
    TOTAL = "total"
    ACROSS = "across"
    WORKSPACE = "workspace"
    TURN = "turn"
    TIP = "tip"
    GAIN = "gain"
    RETRACT_WAITS = "waits"
    NO_FORCE = "no-force"
    # --- ends of the task
    HELD_APPROACH = "held-approach"
    NO_CONTACT = "no-contact"
    UNANSWERED_TOUCH = "unanswered-touch"
    UNTESTED_TOUCH = "untested-touch"
    SURFACE_ENDED = "surface-ended"
    CONTACT_LOST = "contact-lost"
    RETRACT_BORDER = "retract-border"
    RETRACT_BLIND = "retract-blind"
    TOUCH = "touch"
    LEAVES_WORKSPACE = "leaves-workspace"
    STEP_WALL = "step-wall"
    NO_PROGRESS = "no-progress"
    NOT_FOUND = "not-found"
    NO_EDGE = "no-edge"
    NOT_THERE = "not-there"
    DRIFT = "drift"
    NO_READING = "no-reading"
    TRAVELLED = "travelled"
    TIME_IS_UP = "time-is-up"
    # --- around the cycles
    ROBOT_FAILED = "robot-failed"
    REFUSED_ORDER = "refused-order"
    DEAD_LINK = "dead-link"
    CUT_WIRE = "cut-wire"
    SLOW_CYCLES = "slow-cycles"
    BUG = "bug"
    PLUGIN_CODE = "code-of-others"
    CELL_FAILED = "cell-failed"
    GATE = "gate"
    OUTPUT = "output"
    CANCELLED = "cancelled"
    SIGNAL = "signal"
    KEY = "key"
    PAGE = "page"
    INTERRUPTED = "interrupted"
    CUT = "cut"
    # --- at the end
    NOT_AWAY = "not-away"
    PLACE_UNKNOWN = "place-unknown"
    LEFT_PRESSING = "left-pressing"
    LEFT_UNKNOWN = "left-unknown"
    LEFT_DISAGREEING = "left-disagreeing"


def describe_lateness(late_s: float) -> str:
    """Return a description of how late the computer that runs the bridge was (`late_s`, s); empty if it was on time."""
    return f"this computer was late by up to {late_s * 1e3:.0f} ms" if late_s else ""


class Reason(Struct, frozen=True):
    """Cause with its message."""

    cause: Cause
    text: str = ""
    """Description of the fact, including its values."""
    remedy: str = ""
    """What an operator can do."""
    step: str = ""
    """Label of the program's step in which the cause arose; empty if there is none."""
    late_s: float = 0.0
    """Longest time by which this computer was late during the previous second, s; 0 if it was on time."""
    facts: str = ""
    """Further facts about the cause, such as the device's status afterwards."""

    @property
    def fact(self) -> str:
        """Fact with the step in which it arose, without the remedy."""
        if not self.step or self.cause is Cause.STEP_CODE:  # its text begins with the step
            return self.text
        return f"{self.text}, in step {self.step}"

    def in_step(self, label: str) -> "Reason":
        """Return the reason with the step of a program in which it arose. A step that is already set is kept."""
        return self if self.step else structs.replace(self, step=label)

    def __str__(self) -> str:
        return "; ".join(filter(None, (self.fact, describe_lateness(self.late_s), self.facts, self.remedy)))
