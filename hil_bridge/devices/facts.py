"""Facts of the devices of a run, as plain values for the run, its recording and its reports.

The device packages provide them when a run begins. A hop is the part of a cycle between two moments. A moment is a
stamp of the cycle (`CycleRecord`), a ground truth of an emulated cell (`TruthRecord`), or `earliest_at` (see
`analysis.latency.earliest_arrivals`). It may also be derived from a stamp by the robot's facts.
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
"""Moment at which the robot accepts the cycle's order and begins to answer it."""

PACKETS, ANSWERS, LATE = "packets", "answers", "late answers"
"""Counters of a stream's link: the first two increase in normal operation, the third with each answer that took longer
than a cycle of the robot.
"""
MISSING = "packets missing"
"""Counter of a stream's link: sequence numbers that the robot's packets skip."""
_CYCLES_MISSING = "cycles missing"
"""Label of the same counter for a wire that loses nothing."""


class Owner(StrEnum):
    """Part of the system that a hop's time is attributed to."""

    DEVICE = "device"
    """The sensor's electronics."""
    BUS = "bus"
    """The sensor's wire and its converters."""
    SOFTWARE = "software"
    LINE = "line"
    ROBOT = "robot"


class Hop(Struct, frozen=True):
    """Part of a cycle between two moments."""

    name: str
    begin: str
    end: str
    owner: Owner
    words: str
    """Cause of this time, as part of a sentence."""


class Moment(Struct, frozen=True):
    """Moment that no device stamps."""

    name: str
    stamp: str
    """Stamp that it is derived from."""
    earlier_s: float
    """Time by which it precedes its stamp, s."""


class RobotHops(Struct, frozen=True):
    """Hops into which a robot's stamps divide a cycle from `sent_at` on."""

    to_answer: tuple[Hop, ...]
    """Hops from `sent_at` to the answer of the order, each beginning where another ends."""
    to_motion: tuple[tuple[Hop, ...], ...] = ()
    """Sequences of hops from `sent_at` to the motion. The first one applies whose last hop never ends before it begins,
    otherwise the last.
    """
    beside: tuple[Hop, ...] = ()
    """Hops that run in parallel; the sample does not wait for them."""
    moments: tuple[Moment, ...] = ()

    def earlier_s(self, name: str) -> float | None:
        """Return the time by which a derived moment precedes its stamp, s; None for one that is not derived."""
        return next((moment.earlier_s for moment in self.moments if moment.name == name), None)


class Traffic(Struct, frozen=True):
    """Two counters of the robot's link that measure its traffic."""

    what: str
    """Unit of the traffic: bids, blocks, packets …"""
    sent: str
    """Name of the counter."""
    received: str


class ServoFacts(Struct, frozen=True):
    """Servo of the robot."""

    interpolation_s: _Positive
    """Time between two set points of the interpolator."""
    transport_delay_s: _NotNegative
    natural_frequency_rad_s: _Positive
    damping_ratio: _Positive
    dead_band_steps: _NotNegative = 0.0
    """Largest position error without correction, in either direction, in steps of the position."""
    marks: dict[str, str] = {}
    """Source of each number, see `protocol.marks`, by field name; none for a number that is 0."""
    trail_s: _NotNegative = 0.0
    """Time constant with which the robot's own set point follows the ordered one; 0 if it is adopted at once."""

    @property
    def lag_s(self) -> float:
        """Delay of a steady motion after its orders, s."""
        return self.transport_delay_s + self.trail_s + 2.0 * self.damping_ratio / self.natural_frequency_rad_s

    @property
    def wait_s(self) -> float:
        """Mean time for which an order waits for the interpolator, s: half of the time between two set points.

        Derived from the emulated robots: an order arrives at any time between two set points, and the next set point is
        one tick further along the path. A force correction is then complete.
        """
        return self.interpolation_s / 2.0


class WitnessFacts(Struct, frozen=True):
    """Robot's own estimate of the force on its tool: a reference for the force sensor."""

    ordinary_n: _Positive
    """Ordinary difference from the force sensor, N, relative to zeros taken at the same time."""
    delay_s: _NotNegative = 0.0
    """Time constant of its filter."""


class Pacing(StrEnum):
    """Side that drives the cycle."""

    ASKED = "asked"
    """Reports are sent on request."""
    STREAMED = "streamed"
    """Reports are sent at the robot's clock, and each is answered at once."""


class RobotFacts(Struct, frozen=True):
    """Facts about the robot and its wire."""

    model: str = ""
    """Maker, controller and protocol, for display."""
    pacing: Pacing = Pacing.ASKED
    """Side that drives the cycle."""
    kind: str = ""
    """Name of its kind; empty if unknown."""
    emulated: bool = False
    cycle_s: _Positive | None = None
    """Time between two reports; None: as fast as requests are answered."""
    position_step_m: _Positive | None = None
    """Resolution of the reached position; None: negligible or unknown."""
    order_step_m: _Positive | None = None
    """Resolution of an ordered position; None: negligible or unknown."""
    position_noise_m: _NotNegative = 0.0
    """Standard deviation of the reported position, in addition to its resolution; 0: negligible or unknown."""
    line_floor_s: _Positive | None = None
    """Shortest time of one cycle on the robot's wire; None: negligible."""
    byte_time_s: _Positive | None = None
    """Time of a byte on the wire; None: negligible."""
    servo: ServoFacts | None = None
    hops: RobotHops | None = None
    routine: tuple[str, ...] = ()
    """Counters of its link that increase in normal operation; every other one indicates a problem."""
    errors: tuple[str, ...] = ()
    """Counters of problems that a view adds up."""
    traffic: tuple[Traffic, ...] = ()
    late: str = ""
    """Description of how a streaming robot reacts to late answers."""
    witness: WitnessFacts | None = None
    """None if the robot reports no force of its own."""

    def counter_label(self, counter: str) -> str:
        """Return the label of a counter of its link.

        A stream whose errors do not include missing packets runs over a lossless wire such as TCP. Then its controller
        has skipped those cycles.
        """
        is_lossless = bool(self.errors) and MISSING not in self.errors
        return _CYCLES_MISSING if counter == MISSING and is_lossless else counter

    def servo_source(self, *fields: str) -> str:
        """Return a description of where these numbers of its servo come from."""
        if self.emulated:
            return "as configured for the emulated robot"
        marks = {} if self.servo is None else self.servo.marks
        known = dict.fromkeys(marks.get(field, str(Mark.ASSUMED)) for field in fields)
        return f"{' and '.join(known)}, from the profile"


class Sensor(Struct, frozen=True, omit_defaults=True):
    """Facts about the sensor and its electronics."""

    kind: str = ""
    """Name of its kind; empty if unknown."""
    facts: SensorFacts | None = None
    """As its client reports them; None if unknown."""

    @property
    def delay_s(self) -> float | None:
        """Delay of its filter at low frequencies; None if unknown."""
        return None if self.facts is None else self.facts.delay


class Devices(Struct, frozen=True):
    """Robot and sensor of a run."""

    robot: RobotFacts = RobotFacts()
    sensor: Sensor = Sensor()

    def as_metadata(self) -> dict[str, str]:
        """Return metadata for a recording: JSON by device."""
        return {name: msgspec.json.encode(getattr(self, name)).decode() for name in self.__struct_fields__}
