"""What can be made to go wrong with an emulated controller at run time, one at a time: one table."""

import math
from collections.abc import Mapping
from typing import TypeAlias

from protocol.arap import RefusalCode, SpontaneousKind
from protocol.values import dataclass

FaultValue: TypeAlias = float | str


@dataclass(frozen=True, slots=True)
class Parameter:
    """A number, or one of some words."""

    default: float | str
    """A whole number asks for whole numbers."""
    meaning: str
    minimum: float = 0.0
    maximum: float = 0.0
    unit: str = ""
    choices: tuple[str, ...] = ()

    @property
    def range_text(self) -> str:
        """What may be given, for people to read."""
        if self.choices:
            return " or ".join(self.choices)
        return f"{self.minimum:g} … {self.maximum:g}{f' {self.unit}' if self.unit else ''}"

    def check(self, given: object) -> FaultValue:
        """The value. Raises ValueError."""
        if self.choices:
            if given not in self.choices:
                raise ValueError(f"must be {self.range_text}, got {given!r}")
            return str(given)
        number = _number(given)
        if not self.minimum <= number <= self.maximum:
            raise ValueError(f"must be a number of {self.range_text}, got {given!r}")
        if isinstance(self.default, int):
            if number != int(number):
                raise ValueError(f"must be a whole number, got {given!r}")
            return int(number)
        return number


def _number(given: object) -> float:
    """NaN for what is none. A truth value is no number here, a text may be one."""
    if isinstance(given, bool) or not isinstance(given, (int, float, str)):
        return math.nan
    try:
        return float(given)
    except (ValueError, OverflowError):
        return math.nan


@dataclass(frozen=True, slots=True)
class Fault:
    """Something that goes wrong."""

    meaning: str
    parameters: Mapping[str, Parameter]


_COUNT = Parameter(1, "how many in a row", 1, 1000)


def _seconds(default: float, meaning: str) -> Parameter:
    return Parameter(default, meaning, 0.0, 3600.0, "s")


def _word(default: int, meaning: str) -> Parameter:
    return Parameter(default, meaning, 0, 0xFFFF)


def _offset(axis: str) -> Parameter:
    return Parameter(0.0, f"by how much along base {axis}", -100.0, 100.0, "mm")


FAULTS: Mapping[str, Fault] = {
    # --- on the link
    "drop-ack": Fault(
        "the controller's next ACK is lost",
        {
            "of": Parameter("block", "what it acknowledges", choices=("block", "bid")),
            "count": _COUNT,
        },
    ),
    "nak-block": Fault(
        "the next block arrives damaged at the controller, which answers NAK", {"count": _COUNT}
    ),
    "corrupt-block": Fault("the controller's next block has a wrong check character", {"count": _COUNT}),
    "lose-eot": Fault("the controller's next EOT is lost", {"count": _COUNT}),
    "babble": Fault("random bytes come from the controller", {"count": Parameter(20, "how many", 1, 4096)}),
    "silence": Fault(
        "the controller neither hears nor says anything", {"seconds": _seconds(5.0, "how long")}
    ),
    "line-break": Fault(
        "the line is held in break: one 00 byte, then nothing gets through either way",
        {"seconds": _seconds(2.0, "how long")},
    ),
    # --- in the controller
    "late-answer": Fault("the next order is answered late", {"seconds": _seconds(3.0, "by how much")}),
    "refuse": Fault(
        "the next order is refused",
        {
            "code": _word(RefusalCode.NOT_POSSIBLE.value, "refusal code"),
            "function": Parameter(0, "only an order with this function code; 0 for any", 0, 255),
        },
    ),
    "spontaneous": Fault(
        "the controller tells a status or error unasked",
        {
            "kind": _word(SpontaneousKind.OPERATIONAL_ERROR.value, "function suffix: 7, 9, 10, 17"),
            "x": _word(13, 'first half of "x.y"'),
            "y": _word(0, 'second half of "x.y"'),
        },
    ),
    "power-cycle": Fault(
        "the controller starts anew and has forgotten orders, queue and mode",
        {"after_bytes": Parameter(0, "when it has said so many more bytes, in mid-message", 0, 4096)},
    ),
    # --- in the arm
    "freeze": Fault(
        "the interpolator stands still, points are queued", {"seconds": _seconds(5.0, "how long")}
    ),
    "encoder-offset": Fault(
        "the position that the controller measures jumps, and it drives the arm as far the other way",
        {f"{axis}_mm": _offset(axis) for axis in "xyz"},
    ),
}


def fault_values(name: str, given: Mapping[str, object]) -> dict[str, FaultValue]:
    """All parameters of a fault, with defaults for those not given. Raises ValueError in one line."""
    fault = FAULTS.get(name)
    if fault is None:
        raise ValueError(f"no fault is called {name!r}; known: {', '.join(FAULTS)}")
    if unknown := [key for key in given if key not in fault.parameters]:
        raise ValueError(f"{name} has no parameter {unknown[0]!r}; known: {', '.join(fault.parameters)}")
    values: dict[str, FaultValue] = {}
    for key, parameter in fault.parameters.items():
        try:
            values[key] = parameter.check(given[key]) if key in given else parameter.default
        except ValueError as error:
            raise ValueError(f"{name}: {key} {error}") from None
    return values
