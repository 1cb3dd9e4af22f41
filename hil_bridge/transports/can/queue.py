"""Parts that every CAN wire needs for sending: a bounded queue whose frames do not grow old, and its counts."""

import math
from collections import deque
from dataclasses import dataclass

from hil_bridge.errors import TransportError
from hil_bridge.transports.base import Frames
from hil_bridge.transports.delivery import QUEUE_FRAMES
from protocol.can.frame import CanFrame

SEND_DEADLINE_S = 0.1
"""Longest wait of a frame while nothing leaves, s. Chosen: after that a command is worse than none."""


@dataclass(frozen=True, slots=True)
class CanStatistics:
    """Counts of a node of a CAN bus since it was opened."""

    sent: int = 0
    """Frames that the interface has taken; on a bus in memory, frames that were acknowledged."""
    received: int = 0
    """Frames of other nodes that were handed over."""
    dropped: int = 0
    """Frames to send that were given up."""
    error_frames: int = 0
    """Reports of trouble: of the interface and of the transport."""
    bus_off: int = 0
    """Number of times that the node had to leave the bus because of its errors."""
    malformed: int = 0
    """Arrivals that were no classical CAN frame."""
    overruns: int = 0
    """Arrivals lost because the client did not take them in time."""


@dataclass(slots=True)
class Arrived:
    """Counts of the receiving side of a node."""

    frames: int = 0
    reports: int = 0
    """Reports of trouble."""
    bus_off: int = 0


class SendQueue:
    """Frames that wait for the bus, in order.

    A frame is given up when it has waited for the deadline and nothing has left meanwhile. A slow bus delays; a stuck
    one does not keep old commands for later.
    """

    __slots__ = ("_deadline", "_name", "dropped", "frames", "progress", "sent")

    def __init__(self, name: str, deadline_s: float = SEND_DEADLINE_S) -> None:
        self._name = name
        self._deadline = deadline_s
        self.frames: deque[tuple[float, CanFrame]] = deque()
        """Since when each waits, s, and the frame."""
        self.progress = float("-inf")
        """When a frame left last, s."""
        self.sent = 0
        self.dropped = 0

    def __len__(self) -> int:
        return len(self.frames)

    def statistics(self, arrived: "Arrived", overruns: int, malformed: int = 0) -> CanStatistics:
        """Return the counts of the node that sends from here."""
        return CanStatistics(
            self.sent, arrived.frames, self.dropped, arrived.reports, arrived.bus_off, malformed, overruns
        )

    @property
    def head(self) -> CanFrame:
        """The frame that is next."""
        return self.frames[0][1]

    @property
    def give_up_at(self) -> float:
        """When the next frame is given up, s; never if there is none."""
        if not self.frames:
            return math.inf
        since, progress = self.frames[0][0], self.progress
        return (since if since > progress else progress) + self._deadline

    def put(self, frames: Frames, now: float) -> None:
        """Queue all of them. Raises TransportError and queues none when there is no room for all."""
        for frame in frames:
            if frame.error:
                raise ValueError("an error report is not a frame that a node can send")
        if len(self.frames) + len(frames) > QUEUE_FRAMES:
            raise TransportError(
                f"{self._name}: the send queue is full, {QUEUE_FRAMES} frames", remedy="the bus is slower"
            )
        self.frames.extend([(now, frame) for frame in frames])

    def left(self, now: float) -> None:
        """Note that the next frame was sent."""
        self.frames.popleft()
        self.progress = now
        self.sent += 1

    def give_up(self, now: float) -> int:
        """Drop what has waited too long; how many."""
        dropped = 0
        while self.give_up_at <= now:
            self.frames.popleft()
            dropped += 1
        self.dropped += dropped
        return dropped

    def clear(self) -> None:
        """Drop everything."""
        self.dropped += len(self.frames)
        self.frames.clear()
