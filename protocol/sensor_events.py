"""Events from a sensor's client to its owner, for all clients: ordering, statuses, samples, and the end of the
session.

A client contains one `SensorEventQueue`. If the device has a zero and numbers its samples, the client reports the
frames itself. For any other device, it passes raw samples to `sample` or `numbered_sample`, which subtract the
host's zero.
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
    SensorRestarted,
    SensorStopped,
    WrenchFrame,
    Zeroed,
)

_STATUSES_MAX = 16
"""Maximum number of different statuses that are reported. Chosen, so that a status that changes with every sample
does not fill a recording.
"""


class SensorEventQueue:
    """Queue of a session's events, oldest first. It also counts the samples and records the end of the session."""

    __slots__ = ("_events", "_prefix", "_statuses", "_tare", "count", "ended", "ready", "tell")

    def __init__(self, prefix: str = "", zero_samples: int = 1) -> None:
        """Create a queue. `prefix` precedes the text of a failure, including a trailing space. `zero_samples` is
        the number of samples in a zero of the host.
        """
        self._prefix = prefix
        self._tare = HostTare(zero_samples)
        self._events: deque[SensorEvent] = deque()
        self._statuses: set[int] = set()
        self.tell = self._events.append
        """Method that adds an event to the end of the queue. It is the deque's own method, for speed, because it is
        called for every sample.
        """
        self.ready = False
        """Whether the device has started to stream."""
        self.ended = False
        """Whether the session was stopped or has failed."""
        self.count = 0
        """Number of samples reported so far, for a device that does not number them."""

    def next_event(self) -> SensorEvent | None:
        """Return the oldest event not yet taken, or None."""
        return self._events.popleft() if self._events else None

    def notice(self, text: str) -> None:
        """Report a text that should appear in the recording."""
        self._events.append(SensorNotice(text))

    def knows_status(self, status: int) -> bool:
        """Return whether this status was reported before."""
        return status in self._statuses

    def notice_status(self, status: int, text: str) -> None:
        """Report a status of the device when it first occurs, up to sixteen different statuses."""
        if status not in self._statuses and len(self._statuses) < _STATUSES_MAX:
            self._statuses.add(status)
            self.notice(text)

    def require_running(self) -> None:
        """Raise LocalProtocolError if the session has ended."""
        if self.ended:
            raise LocalProtocolError("the session with the sensor has ended")

    def stop(self) -> None:
        """Report that the device has been stopped."""
        self.ended = True
        self._events.append(SensorStopped())

    def fail(self, text: str, remedy: str = "") -> None:
        """Report that the session has failed, with the fault and a remedy for an operator."""
        self.ended = True
        self._events.append(SensorFailed(f"{self._prefix}{text}", remedy))

    def zero(self) -> None:
        """Use the mean of the next samples as zero. Raises LocalProtocolError after the end of the session."""
        self.require_running()
        self._tare.zero()

    def set_zero_samples(self, zero_samples: int) -> None:
        """Set the number of samples in a zero, for a device whose period is unknown at first."""
        self._tare = HostTare(zero_samples)

    def begin(self, facts: SensorFacts) -> None:
        """Report that the device is streaming."""
        self.ready = True
        self._events.append(SensorReady(facts))

    def restart(self) -> None:
        """Report that the device has restarted and lost its zero."""
        self._events.append(SensorRestarted())

    def sample(self, raw: Sequence[float], at: float, saturated: int) -> None:
        """Report a sample of a device that does not number its samples. The sample was complete at time `at`, s."""
        self.count += 1
        self.numbered_sample(raw, self.count, self.count, at, saturated)

    def numbered_sample(
        self, raw: Sequence[float], counter: int, sequence: int, at: float, saturated: int
    ) -> None:
        """Report a sample with the device's own number (`counter`) and this number unwrapped (`sequence`). Report a
        zero that the sample completes.
        """
        self._events.append(WrenchFrame(self._tare.values(raw), counter, sequence, at, saturated))
        if self._tare.took:
            self._events.append(Zeroed())
