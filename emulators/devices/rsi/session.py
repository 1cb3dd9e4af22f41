"""RSI session, from one RSI_ON to its end, and the states of its program."""

import math
from dataclasses import dataclass
from enum import Enum, auto

from emulators.devices.rsi.correction import AxisCorrection, Correction
from emulators.devices.rsi.ethernet import Ethernet


class State(Enum):
    """States of the program that its telegrams show."""

    CREATED = auto()
    """RSI is off: nothing is sent."""
    ON = auto()
    """Telegrams are sent and answers are counted, but nothing moves."""
    MOVECORR = auto()
    """Corrections are applied."""
    ERROR = auto()
    """An error has ended RSI; the robot remains where it stopped."""


@dataclass(slots=True)
class Session:
    """RSI session, from one RSI_ON to its end."""

    begun_at: float
    ethernet: Ethernet
    correction: Correction
    axes: AxisCorrection
    values: dict[str, str]
    """Values of the session's telegrams, including variable ones."""
    sent: int = 0
    """Number of telegrams sent."""
    left_at: float = math.inf
    """Time at which RSI_MOVECORR ended, s."""
    stop_before: bool = False
    """Value of the stop channel in the previous cycle."""
    is_stopped: bool = False
    """Whether the motion is stopped although telegrams continue."""
    restart_at: float = math.inf
    """Time at which an operator restarts the program, s."""
    ended_by_fault: bool = False
    """Whether a fault caused the error that ended the session, and not a client's order."""
    waits: str = ""
    """Reason why RSI_MOVECORR has not begun although it is due."""
