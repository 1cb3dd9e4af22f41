"""RSI from one RSI_ON to its end, and the states of its program."""

import math
from dataclasses import dataclass
from enum import Enum, auto

from emulators.devices.rsi.correction import AxisCorrection, Correction
from emulators.devices.rsi.ethernet import Ethernet


class State(Enum):
    """States of the program, as far as its telegrams show them."""

    CREATED = auto()
    """RSI is off: nothing is sent."""
    ON = auto()
    """Telegrams go out and answers are counted; nothing moves."""
    MOVECORR = auto()
    """Corrections are applied."""
    ERROR = auto()
    """An error has ended RSI; the robot stands where it stopped."""


@dataclass(slots=True)
class Session:
    """RSI from one RSI_ON to its end."""

    begun_at: float
    ethernet: Ethernet
    correction: Correction
    axes: AxisCorrection
    values: dict[str, str]
    """Values of its telegrams, those that change included."""
    sent: int = 0
    """Telegrams that were sent."""
    left_at: float = math.inf
    """When RSI_MOVECORR has ended."""
    stop_before: bool = False
    """Stop channel of the cycle before."""
    standing: bool = False
    """The motion is stopped while telegrams continue."""
    restart_at: float = math.inf
    """When an operator begins the program again."""
    ended_by_fault: bool = False
    """The error that has ended it came by no order of a client."""
    waits: str = ""
    """Why RSI_MOVECORR has not begun although it is due, in words."""
