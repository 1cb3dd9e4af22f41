"""Facts about the devices of a run, as plain values for the run, its recording and its reports.

The device packages provide the facts when a run begins. A hop is the part of a cycle between two events. The time
of an event is a stamp of the cycle (`CycleRecord`), a ground truth of an emulated cell (`TruthRecord`), or
`earliest_at` (see `analysis.latency.earliest_arrivals`). It may also be derived from a stamp by means of the
robot's facts.
"""

from enum import StrEnum
from typing import Annotated, TypeAlias

import msgspec
from msgspec import Meta, Struct

from protocol.marks import Mark
from protocol.wrench import SensorFacts

_Positive: TypeAlias = Annotated[float, Meta(gt=0.0)]
_NotNegative: TypeAlias = Annotated[float, Meta(ge=0.0)]

ACCEPTED = "replied_at"
"""Event at which the robot accepts the order of the cycle and begins to answer it."""

PACKETS, ANSWERS, LATE = "packets", "answers", "late answers"
"""Names of three counters of a stream's link. `PACKETS` and `ANSWERS` increase in normal operation; `LATE` counts
the answers that took longer than a cycle of the robot.
"""
MISSING = "packets missing"
"""Name of the counter of sequence numbers that are missing from a robot's stream of packets."""
_CYCLES_MISSING = "cycles missing"
"""Label of the counter `MISSING` on a lossless link."""


class Owner(StrEnum):
    """Component of the system to which the time of a hop is attributed."""

    DEVICE = "device"
    """The sensor's electronics."""
    BUS = "bus"
    """The sensor's link and its converters."""
    SOFTWARE = "software"
    LINE = "line"
    ROBOT = "robot"


class Hop(Struct, frozen=True):
    """Part of a cycle between two events."""

    name: str
    begin: str
    end: str
    owner: Owner
    words: str
    """Cause of this time, worded as part of a sentence."""


class Moment(Struct, frozen=True):
    """Event without a separate stamp; its time is derived from another stamp."""

    name: str
    stamp: str
    """Stamp from which the time of the event is derived."""
    earlier_s: float
    """Time by which the event precedes the stamp, s."""


class RobotHops(Struct, frozen=True):
    """Hops into which a robot's stamps divide a cycle, beginning at `sent_at`."""

    to_answer: tuple[Hop, ...]
    """Hops from `sent_at` to the answer to the order. Each hop begins at the end of the previous one."""
    to_motion: tuple[tuple[Hop, ...], ...] = ()
    """Alternative sequences of hops from `sent_at` to the motion. The first sequence is used whose last hop never
    has a negative duration; if there is none, the last sequence.
    """
    beside: tuple[Hop, ...] = ()
    """Hops in parallel to the others; the control sample does not wait for them."""
    moments: tuple[Moment, ...] = ()

    def earlier_s(self, name: str) -> float | None:
        """Return the time by which a derived event precedes its stamp, s, or None if the event is not derived."""
        return next((moment.earlier_s for moment in self.moments if moment.name == name), None)


class Traffic(Struct, frozen=True):
    """Two counters of the robot's link that measure its traffic."""

    what: str
    """Unit in which the traffic is counted: bids, blocks, packets …"""
    sent: str
    """Name of the counter of sent units."""
    received: str


class ServoFacts(Struct, frozen=True):
    """Facts about the robot's servo."""

    interpolation_s: _Positive
    """Time between two set points of the interpolator, s."""
    transport_delay_s: _NotNegative
    natural_frequency_rad_s: _Positive
    damping_ratio: _Positive
    dead_band_steps: _NotNegative = 0.0
    """Largest position error in either direction that the servo does not correct, in position steps."""
    marks: dict[str, str] = {}
    """Source of each number by field name, see `protocol.marks`. A number that is 0 has no source."""
    trail_s: _NotNegative = 0.0
    """Time constant with which the robot's internal set point follows the ordered one, s; 0 if the robot adopts it
    at once.
    """

    @property
    def lag_s(self) -> float:
        """Delay between the orders and a steady motion, s."""
        return self.transport_delay_s + self.trail_s + 2.0 * self.damping_ratio / self.natural_frequency_rad_s

    @property
    def wait_s(self) -> float:
        """Mean time for which an order waits for the interpolator, s: half of the time between two set points.

        Derived from the emulated robots: an order arrives at a random time between two set points, and the next set
        point is one tick further along the path. A force correction is complete at that set point.
        """
        return self.interpolation_s / 2.0


class WitnessFacts(Struct, frozen=True):
    """Facts about the robot's own estimate of the force on its tool, which serves as a reference for the force
    sensor.
    """

    ordinary_n: _Positive
    """Difference from the force sensor in normal operation, N, if both zeros were taken at the same time."""
    delay_s: _NotNegative = 0.0
    """Time constant of the estimate's filter, s."""


class Pacing(StrEnum):
    """Side that determines when a cycle begins."""

    ASKED = "asked"
    """The robot sends a report on request."""
    STREAMED = "streamed"
    """The robot sends reports by its own clock, and each report is answered at once."""


class RobotFacts(Struct, frozen=True):
    """Facts about the robot and its link."""

    model: str = ""
    """Manufacturer, controller and protocol, for display."""
    pacing: Pacing = Pacing.ASKED
    """Side that determines when a cycle begins."""
    kind: str = ""
    """Name of the robot's kind; empty if unknown."""
    emulated: bool = False
    cycle_s: _Positive | None = None
    """Time between two reports, s; None if the robot sends a report as soon as it is requested."""
    decision_s: _Positive | None = None
    """Shortest period of a run with this robot by default, s, for a robot that follows its orders many cycles later;
    None for one cycle.
    """
    position_step_m: _Positive | None = None
    """Resolution of the reported position, m; None if negligible or unknown."""
    order_step_m: _Positive | None = None
    """Resolution of an ordered position, m; None if negligible or unknown."""
    position_noise_m: _NotNegative = 0.0
    """Standard deviation of the reported position without its resolution, m; 0 if negligible or unknown."""
    line_floor_s: _Positive | None = None
    """Shortest time of one cycle on the robot's link, s; None if negligible."""
    byte_time_s: _Positive | None = None
    """Time of a byte on the link, s; None if negligible."""
    servo: ServoFacts | None = None
    hops: RobotHops | None = None
    routine: tuple[str, ...] = ()
    """Link counters that increase in normal operation. Every other counter indicates a problem."""
    errors: tuple[str, ...] = ()
    """Link counters of problems, whose sum a view displays."""
    traffic: tuple[Traffic, ...] = ()
    late: str = ""
    """Description of how a streaming robot reacts to late answers."""
    witness: WitnessFacts | None = None
    """Facts about the robot's own force estimate; None if the robot does not report a force."""

    def counter_label(self, counter: str) -> str:
        """Return the label of a counter of the robot's link.

        A stream whose errors do not include missing packets uses a lossless link such as TCP. Missing sequence
        numbers are then cycles that the controller has skipped.
        """
        is_lossless = bool(self.errors) and MISSING not in self.errors
        return _CYCLES_MISSING if counter == MISSING and is_lossless else counter

    def servo_source(self, *fields: str) -> str:
        """Return a description of the source of the servo's numbers."""
        if self.emulated:
            return "as configured for the emulated robot"
        marks = {} if self.servo is None else self.servo.marks
        known = dict.fromkeys(marks.get(field, str(Mark.ASSUMED)) for field in fields)
        return f"{' and '.join(known)}, from the profile"


class Sensor(Struct, frozen=True, omit_defaults=True):
    """Facts about the sensor and its electronics."""

    kind: str = ""
    """Name of the sensor's kind; empty if unknown."""
    facts: SensorFacts | None = None
    """Facts that the sensor's client reports; None if unknown."""

    @property
    def delay_s(self) -> float | None:
        """Delay of the sensor's filter at low frequencies, s; None if unknown."""
        return None if self.facts is None else self.facts.delay


class Devices(Struct, frozen=True):
    """Facts about robot and sensor of a run."""

    robot: RobotFacts = RobotFacts()
    sensor: Sensor = Sensor()

    def as_metadata(self) -> dict[str, str]:
        """Return the facts as metadata for a recording: a JSON text for each device."""
        return {name: msgspec.json.encode(getattr(self, name)).decode() for name in self.__struct_fields__}
