"""End of a run and events of its course: facts that only the run itself knows, for its record."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import msgspec

from hil_bridge.errors.causes import Cause, Reason


class Check(StrEnum):
    """Subjects of sensor checks before contact."""

    FACTS = "facts"
    """Full scales and model."""
    UNVERIFIED = "unverified"
    """Axes that the tool's weight does not verify."""
    UNCHECKED = "unchecked"
    """Tool weight unknown, and accepted by the operator."""
    ZERO = "zero"
    """Zero of the sensor."""


class Outcome(StrEnum):
    """Outcome of a run."""

    COMPLETED = "completed"
    STOPPED = "stopped"
    """The supervisor or an error ended it; there is a cause."""
    INTERRUPTED = "interrupted"
    """The operator ended it, or the process was killed."""


@dataclass(frozen=True, slots=True)
class RunEnd:
    """Facts that only the run itself knows when it ends."""

    outcome: Outcome
    reason: Reason | None = None
    """Why it ended; None for a completed run."""
    line_floor_s: float | None = None
    """Shortest time of one cycle's characters on the line."""
    link: Mapping[str, float] = field(default_factory=dict)
    """Counters of the robot's link by name."""
    sensor_lost: int | None = None
    """Sensor frames that were sent but not received, as counted by the gateway client."""
    sensor_delay_s: float | None = None
    """Delay of the sensor's filter at low frequencies."""
    left: str = ""
    """Final position of the tool, as text; empty if it never moved."""
    followed: tuple[Reason, ...] = ()
    """Causes after the first one, in order."""
    rest: Mapping[str, bool | float | list[str] | None] = field(default_factory=dict)
    """Final position of the tool, as values: retracted, depth_m, force_n, unverified; empty if it never moved.
    """
    place: str = ""
    """Only the position, as text; empty if it never moved."""

    @property
    def cause(self) -> Cause | None:
        """Row of the table of causes; None for a completed run."""
        return None if self.reason is None else self.reason.cause

    @property
    def retracted(self) -> bool | None:
        """Whether the tool ended off the surface; None if it never moved, or if that is unknown."""
        return retracted_in(self.rest)

    @property
    def text(self) -> str:
        """Cause as one line of text; empty without one."""
        return "" if self.reason is None else str(self.reason)

    def as_metadata(self) -> dict[str, str]:
        """Return metadata for `Recorder.close`, so that a record includes its end."""
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
    """Return whether the tool ended off the surface, from `RunEnd.rest`; None if unknown."""
    retracted = rest.get("retracted")
    return retracted if isinstance(retracted, bool) else None


def reason_of(end: Mapping[str, str]) -> Reason | None:
    """Return why a recorded run ended, from the metadata of its end; None for a completed run."""
    if end.get("cause", "") not in set(Cause):
        return None
    texts = end.get("text", ""), end.get("remedy", ""), end.get("step", "")
    return Reason(Cause(end["cause"]), *texts, late_s=_seconds(end.get("late_s", "")))


def _seconds(text: str) -> float:
    """Return a recorded time, s; 0 if none was recorded."""
    try:
        return msgspec.json.decode(text, type=float)
    except msgspec.DecodeError:
        return 0.0


def followed_of(end: Mapping[str, str]) -> tuple[Reason, ...]:
    """Return the causes that followed the first one, from the metadata of the end."""
    try:
        return msgspec.json.decode(end.get("followed") or "[]", type=tuple[Reason, ...])
    except msgspec.DecodeError:  # of an earlier version
        return ()


def words_of(end: Mapping[str, str]) -> dict[str, object]:
    """Describe the end for a page: outcome, cause, place and consequences; and whether the tool was retracted."""
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
