"""Faults that void a promise, and why: one table of data.

The guard knows the world through one sensor and one robot. What it promises of the true force holds as long as these
do not lie, and as long as nothing but the robot moves.
"""

from collections.abc import Iterable
from typing import NamedTuple

from hil_bridge.control.course.intent import BEFORE_TOUCH
from hil_bridge.lab.invariants.evidence import Promise
from hil_bridge.settings.faults import FaultConfig

BEFORE = ("", *BEFORE_TOUCH)
"""Phases before anything moves. A fault without a phase begins in the first."""


class Void(NamedTuple):
    """Faults that void some promises."""

    promises: frozenset[Promise]
    on: str
    faults: frozenset[str]
    """Names at that target; empty for all."""
    why: str
    unless_checked: bool = False
    """A fault that is there before anything moves does not void: the check before the run has to find it."""

    def covers(self, promise: Promise, fault: FaultConfig) -> bool:
        """Whether this fault voids this promise."""
        if promise not in self.promises or fault.on != self.on:
            return False
        if self.faults and fault.fault not in self.faults:
            return False
        checked = fault.phase in BEFORE and not fault.after_s and not fault.when and fault.for_s is None
        return not (self.unless_checked and checked)


_FORCES = frozenset({Promise.BOUND, Promise.END, Promise.LAST_LINE})
_DEPTHS = frozenset({Promise.BOUND, Promise.END, Promise.LAST_LINE, Promise.ORDERS, Promise.SPEED})
_BOUND = frozenset({Promise.BOUND})
_SENSOR_LIES = "the sensor tells another force than there is"
_ROBOT_LIES = "the robot tells another place than its own, or does not do what it took"
_MOVES = "the surface or an obstacle moves by itself, however the tool stands still"
_LATE = "forces or orders come late or twice, and nothing on the wire tells it"

VOIDS: tuple[Void, ...] = (
    Void(
        _FORCES,
        "signal",
        frozenset({"dead", "scale", "offset", "sign", "swapped"}),
        _SENSOR_LIES,
        unless_checked=True,
    ),
    Void(
        _FORCES,
        "signal",
        frozenset({"stuck", "replayed", "drift", "turned", "noise", "spike", "intermittent"}),
        _SENSOR_LIES,
    ),
    Void(_FORCES, "sensor", frozenset({"wrong-scales"}), _SENSOR_LIES, unless_checked=True),
    Void(_FORCES, "sensor", frozenset({"biased", "saturated", "threshold", "unplugged"}), _SENSOR_LIES),
    Void(_FORCES, "sensor-wire", frozenset({"corrupted", "garbled"}), _SENSOR_LIES),
    Void(_FORCES, "bus", frozenset({"babble", "errors"}), _SENSOR_LIES),
    Void(_FORCES, "sensor", frozenset({"slow", "frozen-counter"}), _LATE),
    Void(_FORCES, "sensor-wire", frozenset({"late", "twice", "reordered"}), _LATE),
    Void(_DEPTHS, "pose", frozenset(), _ROBOT_LIES),
    Void(_DEPTHS, "wire", frozenset({"late", "twice", "reordered", "corrupted", "garbled", "babble"}), _LATE),
    Void(_DEPTHS, "robot", frozenset({"spontaneous", "limit", "slider"}), _ROBOT_LIES),
    Void(_DEPTHS, "robot", frozenset({"clock-jump"}), _LATE),
    Void(_FORCES, "surface", frozenset(), _MOVES),
    Void(_FORCES, "obstacle", frozenset(), _MOVES),
    Void(_BOUND, "computer", frozenset({"pause"}), "the computer decides nothing meanwhile"),
)
"""Every fault that voids a promise. What is not in it voids nothing."""


def void_reasons(promise: Promise, faults: Iterable[FaultConfig]) -> tuple[str, ...]:
    """Why a promise is void in a run with these faults; empty where it holds."""
    reasons = (row.why for fault in faults for row in VOIDS if row.covers(promise, fault))
    return tuple(dict.fromkeys(reasons))
