"""Sending side of every CAN wire: a bounded queue that drops old frames, and counts."""

import math
from collections import deque
from dataclasses import dataclass

from hil_bridge.errors import TransportError
from hil_bridge.transports.base import Frames
from hil_bridge.transports.delivery import QUEUE_FRAMES
from protocol.can.frame import CanFrame

SEND_DEADLINE_S = 0.1
"""Longest wait of a frame while no frame is sent, s. Chosen: after that time, a command does more harm than good."""


@dataclass(frozen=True, slots=True)
class CanStatistics:
    """Counts of a node of a CAN bus since it was opened."""

    sent: int = 0
    """Number of frames that the interface has accepted. On a bus in memory, the number of acknowledged frames."""
    received: int = 0
    """Number of delivered frames of other nodes."""
    dropped: int = 0
    """Number of frames that were dropped before sending."""
    error_frames: int = 0
    """Number of error reports of the interface and of the transport."""
    bus_off: int = 0
    """Number of times that the node went bus-off because of its errors."""
    malformed: int = 0
    """Number of received frames that were not classical CAN frames."""
    overruns: int = 0
    """Number of received frames that were lost because the client did not read them in time."""


@dataclass(slots=True)
class Arrived:
    """Counts of the receiving side of a node."""

    frames: int = 0
    reports: int = 0
    """Number of error reports."""
    bus_off: int = 0


class SendQueue:
    """Queue of frames that wait for the bus.

    A frame is dropped if it has waited for the deadline and no other frame was sent in that time. A slow bus delays
    frames; a blocked bus does not keep old commands for later.
    """

    __slots__ = ("_deadline", "_name", "dropped", "frames", "progress", "sent")

    def __init__(self, name: str, deadline_s: float = SEND_DEADLINE_S) -> None:
        self._name = name
        self._deadline = deadline_s
        self.frames: deque[tuple[float, CanFrame]] = deque()
        """Queued frames, each with the time at which its wait began, s."""
        self.progress = float("-inf")
        """Time at which the last frame was sent, s."""
        self.sent = 0
        self.dropped = 0

    def __len__(self) -> int:
        return len(self.frames)

    def statistics(self, arrived: "Arrived", overruns: int, malformed: int = 0) -> CanStatistics:
        """Return the counts of a node, including those of this queue."""
        return CanStatistics(
            self.sent, arrived.frames, self.dropped, arrived.reports, arrived.bus_off, malformed, overruns
        )

    @property
    def head(self) -> CanFrame:
        """Next frame to send."""
        return self.frames[0][1]

    @property
    def give_up_at(self) -> float:
        """Time at which the next frame is dropped, s; infinity if the queue is empty."""
        if not self.frames:
            return math.inf
        since, progress = self.frames[0][0], self.progress
        return (since if since > progress else progress) + self._deadline

    def put(self, frames: Frames, now: float) -> None:
        """Queue all frames. If there is no room for all of them, queue none and raise TransportError."""
        for frame in frames:
            if frame.error:
                raise ValueError("an error report is not a frame that a node can send")
        if len(self.frames) + len(frames) > QUEUE_FRAMES:
            raise TransportError(
                f"{self._name}: the send queue is full, {QUEUE_FRAMES} frames; the bus is slower"
            )
        self.frames.extend([(now, frame) for frame in frames])

    def left(self, now: float) -> None:
        """Remove the next frame because it was sent."""
        self.frames.popleft()
        self.progress = now
        self.sent += 1

    def give_up(self, now: float) -> int:
        """Drop the frames that have waited too long. Return their number."""
        dropped = 0
        while self.give_up_at <= now:
            self.frames.popleft()
            dropped += 1
        self.dropped += dropped
        return dropped

    def clear(self) -> None:
        """Drop all frames."""
        self.dropped += len(self.frames)
        self.frames.clear()
