"""States of an emulated controller with Externally Guided Motion, and the reasons of its stops."""

from collections import Counter
from dataclasses import dataclass, field
from enum import Enum

from emulators.devices.egm.profile import EgmProfile
from emulators.orders import Hindrance
from protocol.devices.egm import Guidance, Motors, Rapid
from protocol.geometry import Pose

EMERGENCY_STOP, MOTORS_OFF, PROGRAM_STOPPED = "emergency-stop", "motors-off", "program-stopped"
"""Names of the stops that an operator can trigger."""
POWERLESS = (EMERGENCY_STOP, MOTORS_OFF)
"""Stops that switch the motors off."""
OUT_OF_BOUNDS = "the input is out of bounds"
"""Text of the controller's error [M]."""


class State(Enum):
    """State of the controller as its datagrams report it: motors, guidance, RAPID [A, except GUIDING]."""

    SET_UP = (Motors.ON, Guidance.STOPPED, Rapid.RUNNING)
    """The session exists, but the guidance has not begun."""
    GUIDING = (Motors.ON, Guidance.RUNNING, Rapid.RUNNING)
    """State that abb_libegm waits for [O:lib]."""
    ENDED = (Motors.ON, Guidance.STOPPED, Rapid.RUNNING, "ended")
    """EGMRun has ended: by convergence, by a digital input, or by EGMStop."""
    RAPID_STOPPED = (Motors.ON, Guidance.STOPPED, Rapid.STOPPED)
    MOTORS_OFF = (Motors.OFF, Guidance.STOPPED, Rapid.STOPPED)
    TIMED_OUT = (Motors.ON, Guidance.ERROR, Rapid.RUNNING)
    """ERR_UDPUC_COMM; the error handler of the program is running."""
    FAILED = (Motors.ON, Guidance.ERROR, Rapid.STOPPED)


class Key(Enum):
    """Operating modes, named as in the web services [O: abb_librws]."""

    AUTO = "AUTO"
    MANUAL = "MANR"
    """Manual, at reduced speed."""
    MANUAL_FULL_SPEED = "MANF"


@dataclass(slots=True)
class Desk:
    """Settings of the controller that no datagram reports."""

    key: Key = Key.AUTO
    speed_percent: int = 100
    """Speed ratio, %."""
    at_main: bool = False
    """Whether the program pointer was set to main, so that a start begins another session."""


STOPPED = (State.RAPID_STOPPED, State.MOTORS_OFF)
OVER = (State.ENDED, State.TIMED_OUT, State.FAILED)


@dataclass(slots=True)
class Stops:
    """Active stops of the robot."""

    names: list[str] = field(default_factory=list)
    """Names of all active stops, by faults and by an operator. A name may occur in both groups."""
    by_hand: set[str] = field(default_factory=set)
    """Names of the stops by an operator at the panel."""

    @property
    def state(self) -> State:
        """Return the state of a session under these stops."""
        return State.MOTORS_OFF if set(POWERLESS) & set(self.names) else State.RAPID_STOPPED


class Session:
    """RAPID program from EGMSetupUC onwards: the state of its guidance, and the error that ended it."""

    def __init__(self, profile: EgmProfile, counters: Counter[str], now: float) -> None:
        self._profile, self._counters = profile, counters
        self.begin(now)

    def begin(self, now: float) -> None:
        """Begin another session: EGMReset, EGMSetupUC and the following statements."""
        self.state, self.error = State.SET_UP, ""
        """State of the guidance, and text of the error that ended it, with the event number if known."""
        self.since = self._converged_since = now
        """Times at which the state was entered, and at which the reference entered the convergence window, s."""
        self.converged = self.end_sent = False
        """Whether the reference is inside the convergence window, and whether a datagram has reported the end of
        the guidance.
        """
        self.origin: Pose | None = None
        """Set point at which the return to the start of the guidance began; None if there is no return."""
        self._counters["sessions"] += 1

    def enter(self, state: State, now: float) -> None:
        """Enter a state in which the guidance has ended or is stopped."""
        self.state, self.since, self.end_sent = state, now, False
        self._counters[f"ended: {state.name}"] += 1

    def resume(self, now: float) -> None:
        """Continue the guidance."""
        self.state, self._converged_since = State.GUIDING, now

    def has_converged(self, converged: bool, now: float) -> bool:
        """Return whether the reference was inside the convergence window for long enough.

        `converged` states whether it is inside now.
        """
        self.converged = converged
        if not converged:
            self._converged_since = now
        return converged and now - self._converged_since >= self._profile.cond_time_s

    @property
    def is_guidable(self) -> bool:
        """Whether messages have an effect."""
        return self.state in (State.SET_UP, State.GUIDING)

    @property
    def sends(self) -> bool:
        """Whether the controller sends datagrams."""
        profile = self._profile
        if self.state in STOPPED:
            return profile.sends_stopped
        if self.state in OVER:
            return profile.send_when == "setup" or (profile.last_datagram and not self.end_sent)
        return True

    def hindrance(self, now: float) -> Hindrance | None:
        """Return the reason why messages have no effect."""
        if self.is_guidable:
            return None
        text = self.state.name.lower().replace("_", " ")
        return Hindrance(f"{text}: {self.error}" if self.error else text, self.error == OUT_OF_BOUNDS)
