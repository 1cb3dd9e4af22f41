"""States of an emulated controller with Externally Guided Motion, and the reasons for which it stands."""

from dataclasses import dataclass
from enum import Enum

from protocol.devices.egm import Guidance, Motors, Rapid

EMERGENCY_STOP, MOTORS_OFF, PROGRAM_STOPPED = "emergency-stop", "motors-off", "program-stopped"
"""Names of the stops by people."""
POWERLESS = (EMERGENCY_STOP, MOTORS_OFF)
"""Stops by which the motors go off."""


class State(Enum):
    """State of the controller, as its datagrams tell it: motors, guidance, RAPID [A but for GUIDING]."""

    SET_UP = (Motors.ON, Guidance.STOPPED, Rapid.RUNNING)
    """The session is there, the guidance has not begun."""
    GUIDING = (Motors.ON, Guidance.RUNNING, Rapid.RUNNING)
    """As abb_libegm waits for it [O:lib]."""
    ENDED = (Motors.ON, Guidance.STOPPED, Rapid.RUNNING, "ended")
    """EGMRun has ended: by convergence, by a digital input, or by EGMStop."""
    RAPID_STOPPED = (Motors.ON, Guidance.STOPPED, Rapid.STOPPED)
    MOTORS_OFF = (Motors.OFF, Guidance.STOPPED, Rapid.STOPPED)
    TIMED_OUT = (Motors.ON, Guidance.ERROR, Rapid.RUNNING)
    """ERR_UDPUC_COMM; the error handler of the program runs."""
    FAILED = (Motors.ON, Guidance.ERROR, Rapid.STOPPED)


class Key(Enum):
    """Operating modes, as the web services name them [O: abb_librws]."""

    AUTO = "AUTO"
    MANUAL = "MANR"
    """Manual, at reduced speed."""
    MANUAL_FULL_SPEED = "MANF"


@dataclass(slots=True)
class Desk:
    """Settings of the controller that no datagram tells."""

    key: Key = Key.AUTO
    speed_percent: int = 100
    """The speed ratio."""
    at_main: bool = False
    """The program pointer was set to main: a start begins another session."""


STOPPED = (State.RAPID_STOPPED, State.MOTORS_OFF)
OVER = (State.ENDED, State.TIMED_OUT, State.FAILED)
