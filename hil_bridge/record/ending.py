"""End of a run and events during the run: facts that only the run itself knows."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import msgspec

from hil_bridge.errors.causes import Cause, Reason


class Check(StrEnum):
    """Subject of a sensor check before contact."""

    FACTS = "facts"
    """Full scales and model of the sensor."""
    UNVERIFIED = "unverified"
    """Axes that the weight of the tool does not verify."""
    UNCHECKED = "unchecked"
    """Tool weight, which is unknown and was accepted by the operator."""
    ZERO = "zero"
    """Zero of the sensor."""


class Outcome(StrEnum):
    """Outcome of a run."""

    COMPLETED = "completed"
    STOPPED = "stopped"
    """The supervisor or an error ended the run; there is a cause."""
    INTERRUPTED = "interrupted"
    """The operator ended the run, or the process was killed."""


@dataclass(frozen=True, slots=True)
class RunEnd:
    """Facts at the end of a run that only the run itself knows."""

    outcome: Outcome
    reason: Reason | None = None
    """Reason why the run ended; None for a completed run."""
    line_floor_s: float | None = None
    """Shortest time that the characters of one cycle take on the line, s."""
    link: Mapping[str, float] = field(default_factory=dict)
    """Counters of the robot's link by name."""
    sensor_lost: int | None = None
    """Number of sensor frames that were sent but not received, as counted by the gateway client."""
    sensor_delay_s: float | None = None
    """Delay of the sensor's filter at low frequencies, s."""
    left: str = ""
    """Description of the final position of the tool; empty if the tool never moved."""
    followed: tuple[Reason, ...] = ()
    """Causes after the first one, in order."""
    rest: Mapping[str, bool | float | list[str] | None] = field(default_factory=dict)
    """Final position of the tool, as the values retracted, depth_m, force_n and unverified; empty if the tool never
    moved.
    """
    place: str = ""
    """Position part of the description `left`; empty if the tool never moved."""

    @property
    def cause(self) -> Cause | None:
        """Row of the table of causes; None for a completed run."""
        return None if self.reason is None else self.reason.cause

    @property
    def retracted(self) -> bool | None:
        """Whether the tool was off the surface at the end; None if the tool never moved, or if the state is unknown."""
        retracted = self.rest.get("retracted")
        return retracted if isinstance(retracted, bool) else None

    @property
    def text(self) -> str:
        """Cause as one line of text; empty without a cause."""
        return "" if self.reason is None else str(self.reason)

    def as_metadata(self) -> dict[str, str]:
        """Return the metadata for `Recorder.close`, so that the recording includes the end of the run."""
        return {
            "outcome": self.outcome.value,
            "cause": self.cause or "",
            "text": "" if self.reason is None else self.reason.text,
            "remedy": "" if self.reason is None else self.reason.remedy,
            "step": "" if self.reason is None else self.reason.step,
            "facts": "" if self.reason is None else self.reason.facts,
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


def reason_of(end: Mapping[str, str]) -> Reason | None:
    """Return the reason why a recorded run ended, from the metadata of its end; None for a completed run."""
    if end.get("cause", "") not in set(Cause):
        return None
    texts = end.get("text", ""), end.get("remedy", ""), end.get("step", "")
    return Reason(
        Cause(end["cause"]), *texts, late_s=_seconds(end.get("late_s", "")), facts=end.get("facts", "")
    )


def _seconds(text: str) -> float:
    """Return a recorded time, s; 0 if the recording has none."""
    try:
        return msgspec.json.decode(text, type=float)
    except msgspec.DecodeError:
        return 0.0


def followed_of(end: Mapping[str, str]) -> tuple[Reason, ...]:
    """Return the causes after the first one, from the metadata of the end."""
    try:
        return msgspec.json.decode(end.get("followed") or "[]", type=tuple[Reason, ...])
    except msgspec.DecodeError:  # written by an earlier version
        return ()
