"""The messages of a sensor's client to its owner, once for all of them: events in order, statuses, samples, the end.

A client composes one `SensorEventQueue`. Of a device that has a zero and numbers its samples, the client tells frames
itself; of another one it gives raw samples to `sample` or `numbered_sample`, which take the host's zero off.
"""

from collections import deque
from collections.abc import Sequence

from protocol.endpoint import LocalProtocolError
from protocol.wrench import (
    HostTare,
    SensorEvent,
    SensorFacts,
    SensorFailed,
    SensorNotice,
    SensorReady,
    SensorStopped,
    WrenchFrame,
    Zeroed,
)

_STATUSES_MAX = 16
"""Chosen: most statuses that are told, so that a status which changes with every sample fills no recording."""


class SensorEventQueue:
    """The events of a session, oldest first, its samples, and its end."""

    __slots__ = ("_events", "_prefix", "_statuses", "_tare", "count", "ended", "ready", "tell")

    def __init__(self, prefix: str = "", zero_samples: int = 1) -> None:
        """`prefix` begins the text of a failure, blank included. So many samples make a zero of the host."""
        self._prefix = prefix
        self._tare = HostTare(zero_samples)
        self._events: deque[SensorEvent] = deque()
        self._statuses: set[int] = set()
        self.tell = self._events.append
        """Tell an event, after all that wait. It is the queue's own method: it is called with every sample."""
        self.ready = False
        """The device streams."""
        self.ended = False
        """The session is stopped or has failed."""
        self.count = 0
        """Samples of a device that numbers none, told so far."""

    def next_event(self) -> SensorEvent | None:
        """Return the oldest event not yet taken, or None."""
        return self._events.popleft() if self._events else None

    def notice(self, text: str) -> None:
        """Tell something worth a line in the record."""
        self._events.append(SensorNotice(text))

    def knows_status(self, status: int) -> bool:
        """Whether this status was told already."""
        return status in self._statuses

    def notice_status(self, status: int, text: str) -> None:
        """Tell a status of the device the first time that it has it; at most sixteen of them."""
        if status not in self._statuses and len(self._statuses) < _STATUSES_MAX:
            self._statuses.add(status)
            self.notice(text)

    def require_running(self) -> None:
        """Raise LocalProtocolError after the end."""
        if self.ended:
            raise LocalProtocolError("the session with the sensor is over")

    def stop(self) -> None:
        """Tell that the device knows that it is not needed any more."""
        self.ended = True
        self._events.append(SensorStopped())

    def fail(self, text: str, remedy: str = "") -> None:
        """Tell that the session is over, with the fault and the advice for an operator."""
        self.ended = True
        self._events.append(SensorFailed(f"{self._prefix}{text}", remedy))

    def zero(self) -> None:
        """Take the mean of the next samples as zero. Raises LocalProtocolError after the end."""
        self.require_running()
        self._tare.zero()

    def set_zero_samples(self, zero_samples: int) -> None:
        """So many samples make a zero from now on: for a device that tells its period late."""
        self._tare = HostTare(zero_samples)

    def begin(self, facts: SensorFacts) -> None:
        """Tell that the device streams."""
        self.ready = True
        self._events.append(SensorReady(facts))

    def sample(self, raw: Sequence[float], at: float, saturated: int) -> None:
        """Tell a sample of a device that numbers none, complete at this time, s."""
        self.count += 1
        self.numbered_sample(raw, self.count, self.count, at, saturated)

    def numbered_sample(
        self, raw: Sequence[float], counter: int, sequence: int, at: float, saturated: int
    ) -> None:
        """Tell a sample by the device's own number, and that number unwrapped; and a zero that it completes."""
        self._events.append(WrenchFrame(self._tare.values(raw), counter, sequence, at, saturated))
        if self._tare.took:
            self._events.append(Zeroed())
