"""Identified value with its method and uncertainty, or with the reason why it cannot be identified."""

import math
from collections.abc import Iterable, Iterator
from enum import StrEnum
from typing import NamedTuple

from msgspec import Struct

from hil_bridge.lab.identification.blocks import Estimate


class Part(StrEnum):
    """Part of a cell. Members are in the order of the output."""

    ROBOT = "robot"
    SENSOR = "sensor"
    SURFACE = "surface"
    LINE = "line errors"


class Why(StrEnum):
    """Reason why a value cannot be identified from a recording."""

    NO_CONTACT = "the tool does not press long enough"
    NO_FORCE = "it contains no force"
    NO_FRAMES = "it has too few frames of the stationary tool in free space"
    NO_FREE_ENDS = "it has too little free space before or after the contact"
    NO_MOTION = "it contains too few positions"
    NO_ORDERS = "it contains no orders"
    NO_TRAVEL = "the tool does not move across the surface in contact"
    NO_STAMPS = "it has too few cycles with all time stamps"
    NO_COUNTERS = "it has no link counters"
    NO_SAMPLES = "it has too few samples"
    STANDS = "a polled robot reaches its order before the next poll"
    NO_STEPS = "the force does not show the steps of the robot"
    NOT_PLAYED = "the emulated robot of this kind cannot replay its orders"
    QUIET_ORDERS = "the orders move too little to determine a lag"
    BELOW_STEP = "the noise is smaller than half a step of the values"
    BELOW_MOTION = "the noise is smaller than the residual of the motion"
    NO_STEP = "no quantisation step is visible above the noise"
    SLOW_FILTER = "a filter below 20 Hz leaves no noise above, and slower noise is attributed to the arm"
    WHITE = "the noise is white up to half the rate of the frames"
    EVEN = "the times are even to 1 µs"
    NO_NOISE = "the noise, which shows the filter, is not identified"
    TOO_OPEN = "its uncertainty exceeds its value"
    BOUNCES = "the tool bounces off the surface repeatedly"
    NO_RAMP = "no part of the contact has long enough rising or falling force without lateral motion"
    BEHIND_DELAY = "a delay of 20 ms between position and force would hide it"
    IN_SERIES = "reported poses do not show the deflection of arm, sensor and tool"
    DRIVES = "another program drives this robot"
    OF_TABLE = "a table has no packet time stamps"


class Value(Struct, frozen=True):
    """Value that was to be identified, with its uncertainty."""

    key: str
    """Name of the value for programs, such as sensor.noise.fx."""
    part: Part
    words: str
    unit: str
    value: float = math.nan
    """Identified value; NaN if it is not identified."""
    low: float = math.nan
    high: float = math.nan
    """Lower and upper end of the 95 % interval."""
    method: str = ""
    interval: str = ""
    """Method by which the interval was computed."""
    why: Why | None = None
    """Reason why the value is not identified; None if it is."""

    @property
    def seen(self) -> bool:
        """Whether the value is identified."""
        return self.why is None

    def holds(self, true: float) -> bool:
        """Return whether the interval contains the value `true`."""
        return self.low <= true <= self.high


class Quantity(NamedTuple):
    """Quantity that is to be identified in a recording."""

    key: str
    """Name of the quantity for programs, such as sensor.noise.fx."""
    part: Part
    words: str
    unit: str

    def value(self, estimate: Estimate, method: str) -> Value:
        """Return the quantity as an identified value."""
        return Value(*self, estimate.value, estimate.low, estimate.high, method, estimate.interval)

    def unseen(self, why: Why) -> Value:
        """Return the quantity as a value that is not identified."""
        return Value(*self, why=why)


class Values:
    """Collection of values by key, in the order of insertion."""

    def __init__(self, values: Iterable[Value] = ()) -> None:
        self._values = {value.key: value for value in values}

    def __iter__(self) -> Iterator[Value]:
        return iter(self._values.values())

    def __len__(self) -> int:
        return len(self._values)

    def get(self, key: str) -> float:
        """Return the number of a value by key; NaN if it is not identified, or was not requested."""
        value = self._values.get(key)
        return math.nan if value is None else value.value

    def find(self, key: str) -> Value | None:
        """Return a value by key, with its method and interval; None if it was not requested."""
        return self._values.get(key)
