"""Facts of the devices of a run, as plain values: a run sees them, a recording keeps them, reports need no more.

The rooms of the devices tell them when a run begins. A hop is a stretch of a cycle between two moments. A moment is a
stamp of the cycle (`CycleRecord`), a truth of an emulated cell (`TruthRecord`), or `earliest_at` (see
`analysis.latency.earliest_arrivals`). It may also be one that the robot's facts derive from a stamp.
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
"""The moment at which the robot has taken the cycle's order: it begins to answer it."""

PACKETS, ANSWERS, LATE = "packets", "answers", "late answers"
"""Counters of a stream's link: the first two go up while all is well, the third with an answer that took longer than a
cycle of the robot.
"""
MISSING = "packets missing"
"""Counter of a stream's link: numbers that the robot's packets leave out."""
_CYCLES_MISSING = "cycles missing"
"""Label of the same counter where the wire itself loses nothing."""


class Owner(StrEnum):
    """Whose time a hop is."""

    DEVICE = "device"
    """The sensor's electronics."""
    BUS = "bus"
    """The sensor's wire and whatever converts it."""
    SOFTWARE = "software"
    LINE = "line"
    ROBOT = "robot"


class Hop(Struct, frozen=True):
    """A stretch of a cycle between two moments."""

    name: str
    begin: str
    end: str
    owner: Owner
    words: str
    """Words for the cause of this time, for a sentence."""


class Moment(Struct, frozen=True):
    """A moment that no device stamps."""

    name: str
    stamp: str
    """The stamp that it is derived from."""
    earlier_s: float
    """How much earlier it is than its stamp."""


class RobotHops(Struct, frozen=True):
    """Hops into which a robot's stamps divide a cycle from `sent_at` on."""

    to_answer: tuple[Hop, ...]
    """Hops from `sent_at` to the answer of the order, each beginning where one ends."""
    to_motion: tuple[tuple[Hop, ...], ...] = ()
    """Ways from `sent_at` to the motion. The first holds whose last hop never ends before it begins, else the last."""
    beside: tuple[Hop, ...] = ()
    """Hops that the sample does not wait for."""
    moments: tuple[Moment, ...] = ()

    def earlier_s(self, name: str) -> float | None:
        """How much earlier than its stamp a derived moment is, s; None for one that is not derived."""
        return next((moment.earlier_s for moment in self.moments if moment.name == name), None)


class Traffic(Struct, frozen=True):
    """Two counters of the robot's link that tell how much goes over it."""

    what: str
    """bids, blocks, packets …"""
    sent: str
    """Name of the counter."""
    received: str


class ServoFacts(Struct, frozen=True):
    """Servo of the robot."""

    interpolation_s: _Positive
    """Between two set points of the interpolator."""
    transport_delay_s: _NotNegative
    natural_frequency_rad_s: _Positive
    damping_ratio: _Positive
    dead_band_steps: _NotNegative = 0.0
    """Largest error of the position without correction, either way, in steps of the position."""
    marks: dict[str, str] = {}
    """How well each number is known, see `protocol.marks`, by the name of its field; none for one that is 0."""
    trail_s: _NotNegative = 0.0
    """Time constant by which the robot's own set point nears what is ordered; 0 for one that takes it at once."""

    @property
    def lag_s(self) -> float:
        """Time by which a steady motion comes after its orders, s."""
        return self.transport_delay_s + self.trail_s + 2.0 * self.damping_ratio / self.natural_frequency_rad_s

    @property
    def wait_s(self) -> float:
        """Mean time for which an order waits for the interpolator, s: half of the time between two set points.

        Derived of the emulated robots: an order comes at any moment between two set points, and the next one is as far
        on the way as a tick goes. A correction of the force is done with it.
        """
        return self.interpolation_s / 2.0


class WitnessFacts(Struct, frozen=True):
    """A robot's own idea of the force on its tool: a witness beside the force sensor."""

    ordinary_n: _Positive
    """Difference from the force sensor that is still ordinary, N, counted from a zero that both took at once."""
    delay_s: _NotNegative = 0.0
    """Time constant of its filter."""


class Pacing(StrEnum):
    """Which side drives the cycle."""

    ASKED = "asked"
    """A report comes when it is asked for."""
    STREAMED = "streamed"
    """Reports come by the robot's clock, and each is answered at once."""


class RobotFacts(Struct, frozen=True):
    """Facts about the robot and the wire to it."""

    model: str = ""
    """Maker, controller and protocol, for people."""
    pacing: Pacing = Pacing.ASKED
    """Which side drives the cycle."""
    kind: str = ""
    """Name of its kind, by which its room is found; empty where it is not known."""
    emulated: bool = False
    cycle_s: _Positive | None = None
    """Time between two reports; None: as fast as questions are answered."""
    position_step_m: _Positive | None = None
    """Resolution of the position that is reached; None: finer than matters, or not known."""
    order_step_m: _Positive | None = None
    """Resolution of a position that is ordered; None: finer than matters, or not known."""
    position_noise_m: _NotNegative = 0.0
    """Standard deviation of the reported position beside its resolution; 0: less than matters, or not known."""
    line_floor_s: _Positive | None = None
    """Shortest time of one cycle on the robot's wire; None: too short to matter."""
    byte_time_s: _Positive | None = None
    """Time of a byte on the wire; None: too short to matter."""
    servo: ServoFacts | None = None
    hops: RobotHops | None = None
    routine: tuple[str, ...] = ()
    """Counters of its link that go up while all is well; every other one tells of trouble."""
    errors: tuple[str, ...] = ()
    """Counters of trouble that a view adds up."""
    traffic: tuple[Traffic, ...] = ()
    late: str = ""
    """Reaction of a robot that streams to answers that come late, in words."""
    witness: WitnessFacts | None = None
    """None where the robot tells no force of its own."""

    def counter_label(self, counter: str) -> str:
        """Label of a counter of its link.

        A stream whose errors do not name missing packets runs over a wire that loses nothing, such as TCP. Its
        controller left those cycles out.
        """
        is_lossless = bool(self.errors) and MISSING not in self.errors
        return _CYCLES_MISSING if counter == MISSING and is_lossless else counter

    def servo_source(self, *fields: str) -> str:
        """Where these numbers of its servo come from, in words."""
        if self.emulated:
            return "as configured for the emulated robot"
        marks = {} if self.servo is None else self.servo.marks
        known = dict.fromkeys(marks.get(field, str(Mark.ASSUMED)) for field in fields)
        return f"{' and '.join(known)}, from the profile"


class Sensor(Struct, frozen=True, omit_defaults=True):
    """Facts about the sensor and its electronics."""

    kind: str = ""
    """Name of its kind, by which its room is found; empty where it is not known."""
    facts: SensorFacts | None = None
    """As its client tells them; None where they are not known."""

    @property
    def delay_s(self) -> float | None:
        """Delay of its filter at low frequencies; None if not known."""
        return None if self.facts is None else self.facts.delay


class Devices(Struct, frozen=True):
    """Robot and sensor of a run."""

    robot: RobotFacts = RobotFacts()
    sensor: Sensor = Sensor()

    def as_metadata(self) -> dict[str, str]:
        """Metadata for a recording: JSON by device."""
        return {name: msgspec.json.encode(getattr(self, name)).decode() for name in self.__struct_fields__}
