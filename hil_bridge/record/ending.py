"""The end of a run and the events of its course: facts that only the run itself knows, for its record."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import msgspec

from hil_bridge.errors.causes import Cause, Reason

PHASE_EVENT = "phase"
"""Kind of the events whose text is the name of the phase that begins."""
STOP_EVENT = "stop"
"""Kind of the event whose text is the cause of a stop."""
CHECK_EVENT = "check"
"""Kind of the events that tell what was found of the sensor before the touch: full scales, model, weight, zero."""
NOT_MODELLED_EVENT = "not-modelled"
"""Kind of the events that tell of a thing which the client uses and the emulated device does not model."""

EVENT_KINDS: Mapping[str, str] = {
    PHASE_EVENT: "A phase of the run begins; the text is its name.",
    CHECK_EVENT: "A finding about the sensor before the touch: full scales, model, weight, zero.",
    STOP_EVENT: "The run is stopped; the text is the cause.",
    "then": "A second cause, after the stop.",
    "pace": "How often the controller decides, and where that is set; told of a controller that does not say it.",
    "step": "A step of a program begins or ends.",
    "fault": "An injected fault begins, has an effect, or ends.",
    "gap": "The computer stood still for a while.",
    "signal": "A signal asks the process to end, as by Ctrl-C.",
    "operator": "A person has asked for something: the end, a hold.",
    "mark": "A person has marked this moment.",
    "robot": "A fact that the robot tells.",
    "motion": "An event of the robot's movement.",
    "link": "The robot's link failed, or tells of a trouble.",
    "sensor": "A device event of the sensor, or its failure.",
    "emulator": "An emulated device tells of a client's mistake.",
    NOT_MODELLED_EVENT: "The client uses something that the emulated device does not model; once for each thing.",
    "line_error": "Characters with a parity or framing error.",
    "telnet_error": "A malformed request or answer of RFC 2217.",
    "wire_lost": "A connection broke and is tried again.",
    "wire_back": "A connection is there again.",
    "absent": "No program takes datagrams at the other end; none was heard from there.",
    "unreachable": "The network does not bring datagrams to the other end.",
    "left": "The program at the other end of a wire of datagrams has left; it was heard before.",
    "stranger": "Datagrams of another sender are refused.",
    "overrun": "A decision took longer than the period; cycles were left out.",
    "traceback": "The traceback of code that failed.",
    "failed": "Code of a plug-in failed; the text names its package and place.",
    "bug": "An exception that nothing expected.",
    "recorder": "Records were dropped.",
    "web": "The server of the page in the browser has ended; the run goes on.",
}
"""Kinds of events, with their meaning. A robot's kind may bring some of its own."""
ALARMS = (STOP_EVENT, "then", "bug", "failed", "traceback", "recorder")
"""Kinds of events that tell why a run stops."""
CAUTIONS = ("fault", "gap", "signal", "operator")
"""Kinds of events that tell of a disturbance, or of a person."""


class Check(StrEnum):
    """Subjects of findings about the sensor before the touch."""

    FACTS = "facts"
    """Full scales and model."""
    UNVERIFIED = "unverified"
    """Axes that the tool's weight does not verify."""
    UNCHECKED = "unchecked"
    """The tool's weight is not known, and a person takes that on."""
    ZERO = "zero"
    """The zero that was taken."""


class Outcome(StrEnum):
    """Outcome of a run."""

    COMPLETED = "completed"
    STOPPED = "stopped"
    """The supervisor or an error ended it; there is a cause."""
    INTERRUPTED = "interrupted"
    """A person ended it, or the process was killed."""


@dataclass(frozen=True, slots=True)
class RunEnd:
    """Facts that only the run itself knows when it ends."""

    outcome: Outcome
    reason: Reason | None = None
    """Why it ended; None for a run that went to its end."""
    line_floor_s: float | None = None
    """Shortest time of one cycle's characters on the line."""
    link: Mapping[str, float] = field(default_factory=dict)
    """Counters of the computer link by name."""
    sensor_lost: int | None = None
    """Sensor frames that were sent and never came, as the client of the gateway counts them."""
    sensor_delay_s: float | None = None
    """Delay of the sensor's filter at low frequencies."""
    left: str = ""
    """Place at which the tool was left, in words; empty when it never moved."""
    followed: tuple[Reason, ...] = ()
    """Causes after the first one, in order."""
    rest: Mapping[str, bool | float | list[str] | None] = field(default_factory=dict)
    """Place at which the tool was left, as values: retracted, depth_m, force_n, unverified; empty when it never moved.
    """
    place: str = ""
    """The place alone, in words; empty when it never moved."""

    @property
    def cause(self) -> Cause | None:
        """Row of the table of causes; None for a run that went to its end."""
        return None if self.reason is None else self.reason.cause

    @property
    def retracted(self) -> bool | None:
        """Whether the tool was left off the surface; None where it never moved, or where that is not known."""
        return retracted_in(self.rest)

    @property
    def text(self) -> str:
        """The cause in words, in one line; empty without one."""
        return "" if self.reason is None else str(self.reason)

    def as_metadata(self) -> dict[str, str]:
        """Metadata for `Recorder.close`, so that a record tells its end by itself."""
        return {
            "outcome": self.outcome.value,
            "cause": self.cause or "",
            "text": "" if self.reason is None else self.reason.text,
            "remedy": "" if self.reason is None else self.reason.remedy,
            "step": "" if self.reason is None else self.reason.step,
            "late_s": json.dumps(0.0 if self.reason is None else self.reason.late_s),
            "line_floor_s": json.dumps(self.line_floor_s),
            "link": json.dumps(dict(self.link), sort_keys=True),
            "sensor_lost": json.dumps(self.sensor_lost),
            "sensor_delay_s": json.dumps(self.sensor_delay_s),
            "left": self.left,
            "followed": json.dumps([msgspec.to_builtins(reason) for reason in self.followed]),
            "rest": json.dumps(dict(self.rest), sort_keys=True),
            "place": self.place,
        }


def retracted_in(rest: Mapping[str, object]) -> bool | None:
    """Whether a tool was left off the surface, by `RunEnd.rest`; None where that is not known."""
    retracted = rest.get("retracted")
    return retracted if isinstance(retracted, bool) else None


def reason_of(end: Mapping[str, str]) -> Reason | None:
    """Why a recorded run ended, by the metadata of its end; None where it went to its end."""
    if end.get("cause", "") not in set(Cause):
        return None
    texts = end.get("text", ""), end.get("remedy", ""), end.get("step", "")
    return Reason(Cause(end["cause"]), *texts, late_s=_seconds(end.get("late_s", "")))


def _seconds(text: str) -> float:
    """A recorded time, s; 0 where none was recorded."""
    try:
        return msgspec.json.decode(text, type=float)
    except msgspec.DecodeError:
        return 0.0


def followed_of(end: Mapping[str, str]) -> tuple[Reason, ...]:
    """Causes that followed the first one, by the metadata of the end."""
    try:
        return msgspec.json.decode(end.get("followed") or "[]", type=tuple[Reason, ...])
    except msgspec.DecodeError:  # of an earlier version
        return ()


def words_of(end: Mapping[str, str]) -> dict[str, object]:
    """The end for a page: outcome, cause, place and what followed, in words; and whether the tool was retracted."""
    reason = reason_of(end)
    try:
        rest = msgspec.json.decode(end.get("rest") or "{}", type=dict[str, object])
    except msgspec.DecodeError:
        rest = {}
    return {
        "outcome": end.get("outcome", ""),
        "cause": "" if reason is None else str(reason),
        "left": end.get("left", ""),
        "retracted": retracted_in(rest),
        "followed": [str(followed) for followed in followed_of(end)],
    }
