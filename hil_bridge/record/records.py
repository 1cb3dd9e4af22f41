"""Records of a run: one for each cycle, the full sensor stream, and events.

The text under a field is also what a recording's schema tells of it, and so what Foxglove shows.
"""

import math
from typing import Annotated, TypeAlias

from msgspec import Meta, Struct

from hil_bridge.control.course.intent import Phase
from hil_bridge.control.sample import Sample
from hil_bridge.errors.causes import Cause, Reason
from hil_bridge.errors.event_kinds import EventKind
from hil_bridge.errors.failures import last_line
from hil_bridge.record.ending import Check
from protocol.faults import FaultStage
from protocol.unmodelled import NotModelled

Vector: TypeAlias = Annotated[tuple[float, ...], Meta(min_length=3, max_length=3)]
Quaternion: TypeAlias = Annotated[tuple[float, ...], Meta(min_length=4, max_length=4)]
Six: TypeAlias = Annotated[tuple[float, ...], Meta(min_length=6, max_length=6)]
"""A wrench, or the joints of a robot."""
Values: TypeAlias = Annotated[tuple[int | float, ...], Meta(min_length=6, max_length=6)]
"""Six values of a sensor: whole numbers of a device that counts."""
PhaseName: TypeAlias = Annotated[str, Meta(extra_json_schema={"enum": [*map(str, Phase)]})]
VerdictName: TypeAlias = Annotated[str, Meta(extra_json_schema={"enum": ["allow", "clamp", "stop"]})]


class CycleRecord(Struct, frozen=True):
    """One control cycle: inputs, estimates, output, verdict, times. Times are seconds on the run's clock."""

    cycle: int
    """Number of the control cycle."""
    phase: PhaseName
    """Phase of the run: approach, track, retract, move, seek, zero or end."""
    # --- times of the hops
    started_at: float
    """Start of the cycle: a polled robot is queried for its position, the report of a streaming one is read, s."""
    controlled_at: float
    """Controller and supervisor have finished, s."""
    sent_at: float
    """The command is handed over, s: its first byte to the port of a polled robot, the target to a stream."""
    answered_at: float
    """End of the cycle: the robot has accepted the command, or the stream has its target, s."""
    # --- inputs
    sample: Sample
    """All measurements on which the decision is based."""
    force: float
    """N along the approach direction, positive while pressing."""
    force_reference: float
    """Target force, N."""
    depth: float
    """Reported position along the approach direction from the start point, m."""
    # --- answer of the controller and verdict of the supervisor
    depth_commanded: float
    """m along the approach direction from the start point, as sent, after rounding to device words."""
    travel_commanded: float
    """m along the tangential direction from the start point."""
    correction: float
    """Change of the commanded depth in this cycle, m; the feedback law's part of it is in `explanation`."""
    stiffness: float | None = None
    """Estimated contact stiffness, N/m."""
    gain: float = 1.0
    """Adaptive gain factor on the feedback law's output, without unit."""
    held: bool = False
    """Whether the controller holds in its dead band: no position that the robot can reach is closer."""
    in_contact: bool = False
    """Whether the tool is in contact with the surface."""
    verdict: VerdictName = "allow"
    """allow, clamp or stop."""
    reasons: tuple[str, ...] = ()
    """Why the supervisor clamped or stopped."""
    explanation: dict[str, float] = {}
    """Further values that explain the controller's output, by name."""
    # --- input for deciding again
    target: Vector = (0.0, 0.0, 0.0)
    """Tool position that the supervisor allowed, robot base frame, m; commanded in whole device steps."""
    start: Vector = (0.0, 0.0, 0.0)
    """Reported tool position at the start point, robot base frame, m."""
    asked: Reason | None = None
    """Why the run was requested to finish before this decision; None in all other cycles."""
    # --- more times of the hops; NaN for a time without a stamp
    status_transmitted_at: float = math.nan
    """The last character of the position query has left the line, calculated from the line rate, s."""
    decoded_at: float = math.nan
    """The sensor frame that the controller uses was decoded, s."""
    proposed_at: float = math.nan
    """The controller has finished; the supervisor begins, s."""
    transmitted_at: float = math.nan
    """The last character of the command has left the line, calculated from the line rate, s."""
    sensor_counter: int = 0
    """Counter of the sensor frame used, as sent by the device."""
    answer_s: float = math.nan
    """Time from the arrival of a stream's packet to its answer, of the packet before this report, s; NaN for a robot
    that is asked.
    """

    across_commanded: float = 0.0
    """m along the third direction of the work frame, from the start point."""
    step: int = 0
    """Number of the program's step, passes counted, from 1; 0 without a program."""
    quaternion_commanded: Annotated[tuple[float, ...], Meta(max_length=4)] = ()
    """Commanded orientation, tool in base, w x y z; empty for the start orientation."""


class StepRecord(Struct, frozen=True):
    """Completed step of a program."""

    at: float
    """End of the step, s on the run's clock."""
    step: int
    """Its number, passes counted, from 1."""
    label: str
    """Its number in the program, and its keyword."""
    began_at: float
    """s on the run's clock."""
    way: float = 0.0
    """Distance along its path, m."""
    force_mean: float | None = None
    """Mean force while it pressed, N; omitted for a step that does not press."""
    within: float | None = None
    """Share of the distance over which the force met its criterion; omitted without a criterion."""
    wanted: float | None = None
    """Share that its criterion requires; omitted without a criterion."""
    passed: bool = True
    """Whether it ended as planned, and met its criterion if it has one."""
    name: str = ""
    """Name of its result."""
    found: Annotated[tuple[float, ...], Meta(max_length=3)] = ()
    """Position that it detected, base frame, m; empty if it searched for none."""
    text: str = ""
    """How it ended, as text."""
    resumable: float = 0.0
    """Distance at which its force was last within its band, m."""
    word: str = ""
    """Its keyword: approach, track, hold, seek, retract, move, zero, or one of a plug-in."""
    repeat: int = 0
    """Number of its repeat in the program; 0 for none."""
    turn: int = 0
    """Its pass in that repeat, from 1; 0 for none."""
    number: str = ""
    """Its number in the program: 3, or 3.1 within a repeat."""


class SensorRecord(Struct, frozen=True):
    """Complete frame of the sensor's stream, with its raw values."""

    at: float
    """Arrival of the frame, s on the run's clock."""
    sequence: int
    """Frame counter, unwrapped."""
    counts: Values
    """fx fy fz mx my mz from the zero as the device counts; the scales of the sensor's facts make N and N·m of them."""


class LinkRecord(Struct, frozen=True):
    """Section of the robot link's log: raw traffic and link events."""

    at: float
    """Time at which its first piece was sent or received, s on the run's clock."""
    pieces: tuple[str, ...]
    """Each: seconds since `at`, `tx` or `rx` as the PC sees it and hexadecimal bytes, or `--` and a link event; of
    several datagrams, a space between them.
    """


class WireRecord(Struct, frozen=True):
    """Section of the raw traffic of a device other than the robot."""

    at: float
    """Time at which its first piece was sent or received, s on the run's clock."""
    device: str
    """sensor."""
    pieces: tuple[str, ...]
    """Each: seconds since `at`, `tx` or `rx` as the PC sees it, and hexadecimal bytes or CAN frames: 190#00FF, R and a
    number for the bytes that a remote frame asks for, and 004!00 where the interface tells of a bus error.
    """


class TruthRecord(Struct, frozen=True):
    """Ground truth of a cycle from an emulated cell. Times are seconds on the run's clock, NaN for events that
    never happened or are not emulated.
    """

    cycle: int
    """Number of the control cycle."""
    at: float
    """Moment of position, force and joints, s: the end of the cycle. With a material that has memory it is up to a few
    ticks of the robot later.
    """
    sampled_at: float
    """The sensor measured the sample that the controller uses, s."""
    motion_at: float
    """The position loops took the first set point on the way to the point that the cycle ordered, s."""
    position: Vector
    """True tool position in the robot base frame, m."""
    force: Vector
    """Force of the surface on the tool tip in the robot base frame, N."""
    joints_deg: Six
    """Axes 1 to 6, °."""
    faults: tuple[str, ...] = ()
    """Injected faults that were active, each as target and name."""
    quaternion: Quaternion = (math.nan,) * 4
    """True orientation, tool in base, w x y z; unknown in older recordings."""
    normal: Vector = (math.nan,) * 3
    """Outward unit normal of the surface below the tool in the robot base frame; not known where a surface tells none.
    """


class FaultNote(Struct, frozen=True):
    """Injected fault and its stage."""

    target: str
    """Part of the cell that it affects."""
    name: str
    """Name of the fault."""
    stage: FaultStage
    """begins, happens, ends, struck, never, refused or by hand."""
    values: dict[str, float] = {}
    """Its numeric parameters, by name."""
    words: dict[str, str] = {}
    """Its text parameters, by name."""
    struck: int | None = None
    """Number of its effects, once the run is over."""

    @property
    def is_injected(self) -> bool:
        """Whether it takes effect from this event on."""
        return self.stage in (FaultStage.BEGINS, FaultStage.HAPPENS)

    @property
    def title(self) -> str:
        """Target and name for display."""
        return f"{self.target}: {self.name}"


class EventRecord(Struct, frozen=True):
    """Event of a run: a phase begins, a device answers late, the supervisor stops the run."""

    at: float
    """s on the run's clock."""
    kind: str
    """Kind of the event."""
    text: str
    """Text of the event."""
    cause: Cause | None = None
    """Row of the table of causes, for an event that ends the run or follows that; omitted in all others."""
    check: Check | None = None
    """Subject of a sensor check; omitted in all other events."""
    by: str = ""
    """Key or signal that the operator used; empty for all other events."""
    fault: FaultNote | None = None
    """Injected fault that the event reports; omitted in all others."""
    not_modelled: NotModelled | None = None
    """Feature that the emulated device does not model; omitted in all other events."""

    @property
    def line(self) -> str:
        """Most informative line of the text: the last one of a traceback, else the first."""
        if self.kind in (EventKind.TRACEBACK, EventKind.BUG):
            return last_line(self.text)
        return self.text.strip().partition("\n")[0]
