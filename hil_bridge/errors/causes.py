"""Causes: why a run is refused, held back, stopped or ended, and the part of a cell that each blames.

A cause travels as a value from where it arises to the page, beside the sentence for people. `cause_table` has a row for
each: words, settings, reaction, exit code and where to look.
"""

from enum import StrEnum

from msgspec import Struct, structs


class Part(StrEnum):
    """Part of a cell, of its surroundings or of the program that a cause blames."""

    ROBOT = "robot"
    ROBOT_LINK = "robot-link"
    POSE = "pose"
    """The position and orientation that the robot reports."""
    SENSOR = "sensor"
    CONTACT = "contact"
    """Tool and surface together."""
    SURFACE = "surface"
    OBSTACLE = "obstacle"
    """Something beside or behind the tool."""
    PATH = "path"
    """The way that the configuration asks for."""
    CONTROLLER = "controller"
    OTHERS_CODE = "code-of-others"
    """Plug-in code."""
    CELL = "cell"
    """The emulated cell, beside the devices that it emulates."""
    COMPUTER = "computer"
    PROGRAM = "program"
    """This program."""
    CONFIGURATION = "configuration"
    PERSON = "person"
    TASK = "task"
    """The task itself, which is done."""


class Cause(StrEnum):
    """Why a run is refused, held back, stopped or ended."""

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
    """Frames come, and carry the same counts."""
    NO_NEW_FRAME = "no-new-frame"
    """No new frame comes."""
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
    OTHERS_CODE = "code-of-others"
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
    """How late the computer that runs the bridge was, s, in words; empty where it was in time."""
    return f"this computer was late by up to {late_s * 1e3:.0f} ms" if late_s else ""


class Reason(Struct, frozen=True):
    """A cause with its sentence for people."""

    cause: Cause
    text: str = ""
    """The fact in words, with its figures."""
    remedy: str = ""
    """Further facts, and what an operator can do, in words."""
    step: str = ""
    """Label of a program's step in which it came; empty without one."""
    late_s: float = 0.0
    """Longest time by which this computer was late in the second before, s; 0 where it was in time."""

    @property
    def fact(self) -> str:
        """The fact with the step in which it came, without a remedy."""
        if not self.step or self.cause is Cause.STEP_CODE:  # its text begins with the step
            return self.text
        return f"{self.text}, in step {self.step}"

    def in_step(self, label: str) -> "Reason":
        """Return the same reason, arisen in a step of a program; the first named step stays."""
        return self if self.step else structs.replace(self, step=label)

    def __str__(self) -> str:
        return "; ".join(filter(None, (self.fact, describe_lateness(self.late_s), self.remedy)))
