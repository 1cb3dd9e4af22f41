"""Identified value with its method and uncertainty, or the reason why it cannot be identified."""

import math
from collections.abc import Iterable, Iterator
from enum import StrEnum
from typing import NamedTuple

from msgspec import Struct

from hil_bridge.lab.identification.blocks import Estimate


class Part(StrEnum):
    """Part of a cell, in the order of the table."""

    ROBOT = "robot"
    SENSOR = "sensor"
    SURFACE = "surface"
    LINE = "line errors"


class Why(StrEnum):
    """Reason why a recording does not show a value."""

    NO_CONTACT = "the tool does not press long enough"
    NO_FORCE = "it tells no force"
    NO_FRAMES = "it has too few frames while the tool stands in free space"
    NO_FREE_ENDS = "it is not long enough in free space both before and after the contact"
    NO_MOTION = "it tells no place, or too few"
    NO_ORDERS = "it tells no orders"
    NO_TRAVEL = "the tool does not move across the surface while it presses"
    NO_STAMPS = "it has too few cycles with all stamps"
    NO_COUNTERS = "it has no counters of the line"
    NO_SAMPLES = "it has too few samples"
    STANDS = "a robot that is asked stands at its order before it is asked again"
    NO_STEPS = "the force does not show the steps of the robot"
    NOT_PLAYED = "the emulated robot of this kind cannot be played its orders"
    QUIET_ORDERS = "the orders move too little to tell a lag"
    BELOW_STEP = "the noise is smaller than half a step of the values"
    BELOW_MOTION = "the noise is smaller than what the motion leaves"
    NO_STEP = "the values lie on no step that their noise lets through"
    SLOW_FILTER = "a filter below 20 Hz leaves nothing above it, and slower noise is the arm's own"
    WHITE = "the noise is white up to half the rate of the frames"
    EVEN = "the times are even to 1 µs"
    NO_NOISE = "the noise is not seen, and it is what tells a filter"
    TOO_OPEN = "the recording leaves it open by more than its own size"
    BOUNCES = "the tool bounces: it loses the surface again and again"
    NO_RAMP = "no part of the contact rises or falls for long enough without moving across"
    BEHIND_DELAY = "20 ms of delay between place and force would hide it"
    DRIVES = "it is the other side that drives this robot"
    OF_TABLE = "a table has no packets and no stamps of them"


class Value(Struct, frozen=True):
    """Identified value."""

    key: str
    """Name for programs, as sensor.noise.fx."""
    part: Part
    words: str
    unit: str
    value: float = math.nan
    """The value; NaN if it is not identified."""
    low: float = math.nan
    high: float = math.nan
    """Ends of the 95 % interval."""
    method: str = ""
    interval: str = ""
    """Method of the interval."""
    why: Why | None = None
    """Why it is not identified; None for a value."""

    @property
    def seen(self) -> bool:
        """Whether the recording shows it."""
        return self.why is None

    def holds(self, true: float) -> bool:
        """Whether the interval holds this value."""
        return self.low <= true <= self.high


class Quantity(NamedTuple):
    """Quantity to be identified in a recording."""

    key: str
    """Name for programs, as sensor.noise.fx."""
    part: Part
    words: str
    unit: str

    def value(self, estimate: Estimate, method: str) -> Value:
        """Return the identified value."""
        return Value(*self, estimate.value, estimate.low, estimate.high, method, estimate.interval)

    def unseen(self, why: Why) -> Value:
        """Return the value as not identified."""
        return Value(*self, why=why)


class Values:
    """Ordered values by key."""

    def __init__(self, values: Iterable[Value] = ()) -> None:
        self._values = {value.key: value for value in values}

    def __iter__(self) -> Iterator[Value]:
        return iter(self._values.values())

    def __len__(self) -> int:
        return len(self._values)

    def get(self, key: str) -> float:
        """Return a value by key; NaN if it is not identified, or was not requested."""
        value = self._values.get(key)
        return math.nan if value is None else value.value

    def find(self, key: str) -> Value | None:
        """Return a value with its method and interval."""
        return self._values.get(key)
