"""Records of a run: one record per cycle, the complete sensor stream, and events.

The docstring of a field is also its description in the recording's schema, which Foxglove displays.
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
"""Six components of a wrench, or six joints of a robot."""
Values: TypeAlias = Annotated[tuple[int | float, ...], Meta(min_length=6, max_length=6)]
"""Six values of a sensor; whole numbers if the device reports counts."""
PhaseName: TypeAlias = Annotated[str, Meta(extra_json_schema={"enum": [*map(str, Phase)]})]
VerdictName: TypeAlias = Annotated[str, Meta(extra_json_schema={"enum": ["allow", "clamp", "stop"]})]


class CycleRecord(Struct, frozen=True):
    """One control cycle: inputs, estimates, output, verdict and times, in seconds on the run's clock."""

    cycle: int
    """Number of the control cycle."""
    phase: PhaseName
    """Phase of the run: approach, track, retract, move, seek, zero or end."""
    # --- times of the hops
    started_at: float
    """Start of the cycle, s: a polled robot is queried for its position, or the report of a streaming robot is read."""
    controlled_at: float
    """Time at which controller and supervisor finished, s."""
    sent_at: float
    """Time at which the command was handed over, s: its first byte to the port of a polled robot, or the target to
    a stream.
    """
    answered_at: float
    """End of the cycle, s: the robot has accepted the command, or the stream has its target."""
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
    """Commanded position along the approach direction from the start point, m, rounded to device units as sent."""
    travel_commanded: float
    """Commanded position along the tangential direction from the start point, m."""
    correction: float
    """Change of the commanded depth in this cycle, m; the feedback law's part of it is in `explanation`."""
    stiffness: float | None = None
    """Estimated contact stiffness, N/m."""
    gain: float = 1.0
    """Adaptive gain factor on the output of the feedback law, dimensionless."""
    held: bool = False
    """Whether the controller holds in its dead band, because no position that the robot can reach is closer."""
    in_contact: bool = False
    """Whether the tool is in contact with the surface."""
    verdict: VerdictName = "allow"
    """Verdict of the supervisor: allow, clamp or stop."""
    reasons: tuple[str, ...] = ()
    """Reasons why the supervisor clamped or stopped."""
    explanation: dict[str, float] = {}
    """Further values that explain the controller's output, by name."""
    # --- input for deciding again
    target: Vector = (0.0, 0.0, 0.0)
    """Tool position that the supervisor allowed, robot base frame, m; commanded in whole device steps."""
    start: Vector = (0.0, 0.0, 0.0)
    """Reported tool position at the start point, robot base frame, m."""
    asked: Reason | None = None
    """Reason why the run was requested to finish before this decision; None in all other cycles."""
    # --- more times of the hops; NaN for a time without a stamp
    status_transmitted_at: float = math.nan
    """Time at which the last character of the position query left the line, computed from the line rate, s."""
    decoded_at: float = math.nan
    """Time at which the sensor frame that the controller uses was decoded, s."""
    proposed_at: float = math.nan
    """Time at which the controller finished and the supervisor started, s."""
    transmitted_at: float = math.nan
    """Time at which the last character of the command left the line, computed from the line rate, s."""
    sensor_counter: int = 0
    """Counter of the sensor frame that the controller uses, as sent by the device."""
    answer_s: float = math.nan
    """Response time to the packet of a stream that preceded this report, from the arrival of the packet, s; NaN for
    a polled robot.
    """

    across_commanded: float = 0.0
    """Commanded position along the third direction of the work frame from the start point, m."""
    step: int = 0
    """Number of the current step of the program, counting every pass, from 1; 0 without a program."""
    quaternion_commanded: Annotated[tuple[float, ...], Meta(max_length=4)] = ()
    """Commanded orientation, tool in base, w x y z; empty for the start orientation."""


class StepRecord(Struct, frozen=True):
    """Completed step of a program."""

    at: float
    """Time at which the step ended, s on the run's clock."""
    step: int
    """Number of the step, counting every pass, from 1."""
    label: str
    """Number of the step in the program, and its keyword."""
    began_at: float
    """Time at which the step began, s on the run's clock."""
    way: float = 0.0
    """Distance travelled along the path of the step, m."""
    force_mean: float | None = None
    """Mean force while the tool pressed, N; omitted for a step that does not press."""
    within: float | None = None
    """Share of the distance over which the force met the step's criterion; omitted without a criterion."""
    wanted: float | None = None
    """Share that the criterion requires; omitted without a criterion."""
    passed: bool = True
    """Whether the step ended as planned, and met its criterion if it has one."""
    name: str = ""
    """Name of the result of the step."""
    found: Annotated[tuple[float, ...], Meta(max_length=3)] = ()
    """Position that the step detected, base frame, m; empty if the step does not search for a position."""
    text: str = ""
    """Description of how the step ended."""
    resumable: float = 0.0
    """Last distance along the path at which the force was within its band, m."""
    word: str = ""
    """Keyword of the step: approach, track, hold, seek, retract, move, zero, or a keyword of a plug-in."""
    repeat: int = 0
    """Number of the repeat in the program that contains the step; 0 if the step is not in a repeat."""
    turn: int = 0
    """Number of the pass of that repeat, from 1; 0 if the step is not in a repeat."""
    number: str = ""
    """Number of the step in the program: 3, or 3.1 within a repeat."""


class SensorRecord(Struct, frozen=True):
    """Complete frame of the sensor's stream, with raw values."""

    at: float
    """Time at which the frame arrived, s on the run's clock."""
    sequence: int
    """Number of the frame, without wrap-around."""
    counts: Values
    """fx fy fz mx my mz relative to the zero, in device counts. The scales in the sensor's facts convert them to N
    and N·m.
    """


class LinkRecord(Struct, frozen=True):
    """Section of the robot link's log: raw traffic and link events."""

    at: float
    """Time at which the first piece was sent or received, s on the run's clock."""
    pieces: tuple[str, ...]
    """Pieces of the log. Each has the seconds since `at`, then `tx` or `rx` from the viewpoint of the PC and
    hexadecimal bytes, or `--` and a link event. A space separates datagrams.
    """


class WireRecord(Struct, frozen=True):
    """Section of the raw traffic of a device other than the robot."""

    at: float
    """Time at which the first piece was sent or received, s on the run's clock."""
    device: str
    """Name of the device: sensor."""
    pieces: tuple[str, ...]
    """Pieces of the traffic. Each has the seconds since `at`, `tx` or `rx` from the viewpoint of the PC, and
    hexadecimal bytes or CAN frames. A CAN frame is 190#00FF; R and a number is the number of bytes that a remote
    frame requests; 004!00 is a bus error that the interface reports.
    """


class TruthRecord(Struct, frozen=True):
    """Ground truth of a cycle from an emulated cell.

    Times are seconds on the run's clock; NaN for an event that never happened or is not emulated.
    """

    cycle: int
    """Number of the control cycle."""
    at: float
    """Time to which position, force and joints apply, s: the end of the cycle; up to a few robot ticks later if the
    material has memory.
    """
    sampled_at: float
    """Time at which the sensor measured the sample that the controller uses, s."""
    motion_at: float
    """Time at which the position loops received the first set point towards the point that the cycle ordered, s."""
    position: Vector
    """True tool position in the robot base frame, m."""
    force: Vector
    """Force of the surface on the tool tip in the robot base frame, N."""
    joints_deg: Six
    """True joint angles of axes 1 to 6, °."""
    faults: tuple[str, ...] = ()
    """Injected faults that were active, each as target and name."""
    quaternion: Quaternion = (math.nan,) * 4
    """True orientation, tool in base, w x y z; unknown in older recordings."""
    normal: Vector = (math.nan,) * 3
    """Outward unit normal of the surface below the tool in the robot base frame; unknown if the surface has no
    normals.
    """
    deflection: Vector = (math.nan,) * 3
    """True tool position minus the position that the robot's encoders measure, robot base frame, m: 0 for a rigid
    arm; unknown in older recordings.
    """


class FaultNote(Struct, frozen=True):
    """Injected fault and the stage that an event reports."""

    target: str
    """Part of the cell that the fault affects."""
    name: str
    """Name of the fault."""
    stage: FaultStage
    """Stage of the fault: begins, happens, ends, struck, never, refused or by hand."""
    values: dict[str, float] = {}
    """Numeric parameters of the fault, by name."""
    words: dict[str, str] = {}
    """Text parameters of the fault, by name."""
    struck: int | None = None
    """Number of times that the fault took effect, once the run is over."""

    @property
    def is_injected(self) -> bool:
        """Whether the fault takes effect from this event on."""
        return self.stage in (FaultStage.BEGINS, FaultStage.HAPPENS)

    @property
    def title(self) -> str:
        """Target and name of the fault, for display."""
        return f"{self.target}: {self.name}"

    @property
    def phrase(self) -> str:
        """Target and name of the fault, in a sentence."""
        return f"{self.target} {self.name}".replace("-", " ")


class EventRecord(Struct, frozen=True):
    """Event of a run, for example the start of a phase, a late answer of a device, or a stop by the supervisor."""

    at: float
    """Time of the event, s on the run's clock."""
    kind: str
    """Kind of the event."""
    text: str
    """Text of the event."""
    cause: Cause | None = None
    """Row of the table of causes if the event ends the run or follows the end; omitted in all other events."""
    check: Check | None = None
    """Subject of a sensor check; omitted in all other events."""
    by: str = ""
    """Key or signal that the operator used; empty in all other events."""
    fault: FaultNote | None = None
    """Injected fault that the event reports; omitted in all other events."""
    not_modelled: NotModelled | None = None
    """Feature that the emulated device does not model; omitted in all other events."""

    @property
    def line(self) -> str:
        """Most informative line of the text: the last line of a traceback, otherwise the first line."""
        if self.kind in (EventKind.TRACEBACK, EventKind.BUG):
            return last_line(self.text)
        return self.text.strip().partition("\n")[0]
