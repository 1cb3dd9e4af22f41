"""States of an emulated controller with Externally Guided Motion, and the reasons for which it stands."""

from collections import Counter
from dataclasses import dataclass, field
from enum import Enum

from emulators.devices.egm.profile import EgmProfile
from emulators.orders import Hindrance
from protocol.devices.egm import Guidance, Motors, Rapid
from protocol.geometry import Pose

EMERGENCY_STOP, MOTORS_OFF, PROGRAM_STOPPED = "emergency-stop", "motors-off", "program-stopped"
"""Names of the stops by people."""
POWERLESS = (EMERGENCY_STOP, MOTORS_OFF)
"""Stops by which the motors go off."""
OUT_OF_BOUNDS = "the input is out of bounds"
"""Words of the controller's error [M]."""


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


@dataclass(slots=True)
class Stops:
    """Stops that hold the robot."""

    names: list[str] = field(default_factory=list)
    """By faults and by hand; one name may be there by both."""
    by_hand: set[str] = field(default_factory=set)
    """Names of those of an operator at the panel."""

    @property
    def state(self) -> State:
        """The state to which they bring a session."""
        return State.MOTORS_OFF if set(POWERLESS) & set(self.names) else State.RAPID_STOPPED


class Session:
    """The RAPID program from EGMSetupUC on: the state of its guidance, and what has ended it."""

    def __init__(self, profile: EgmProfile, counters: Counter[str], now: float) -> None:
        self._profile, self._counters = profile, counters
        self.begin(now)

    def begin(self, now: float) -> None:
        """Another session: EGMReset, EGMSetupUC and what follows."""
        self.state, self.error = State.SET_UP, ""
        """`error` is in words, with the number of its event where that is known."""
        self.since = self._converged_since = now
        """When the state, and the window of convergence, were entered, s."""
        self.converged = self.end_sent = False
        """`end_sent`: a datagram has told that the guidance is over."""
        self.origin: Pose | None = None
        """Set point at which the return to the start of the guidance began; None without one."""
        self._counters["sessions"] += 1

    def enter(self, state: State, now: float) -> None:
        """End or stop the guidance in this state."""
        self.state, self.since, self.end_sent = state, now, False
        self._counters[f"ended: {state.name}"] += 1

    def resume(self, now: float) -> None:
        """Continue the guidance."""
        self.state, self._converged_since = State.GUIDING, now

    def has_converged(self, converged: bool, now: float) -> bool:
        """Whether the reference was inside the window of convergence for long enough; it is `converged` now."""
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
        """Why messages have no effect."""
        if self.is_guidable:
            return None
        words = self.state.name.lower().replace("_", " ")
        return Hindrance(f"{words}: {self.error}" if self.error else words, self.error == OUT_OF_BOUNDS)
