"""Messages of a client on their way to the motion of a controller with EGM: the queue, and the delay behind it."""

import math
from collections import deque

from emulators.devices.egm.profile import EgmProfile
from protocol.devices.egm import Answer

_BEGINS = 256
"""Chosen: begins of motion that are kept."""


class MessageQueue:
    """Accepted messages, and the times at which they begin to act."""

    def __init__(self, profile: EgmProfile) -> None:
        self._profile = profile
        self._messages: deque[Answer] = deque()
        self._delayed: deque[Answer | None] = deque()
        """Message that each of the last cycles took from the queue, None for none."""
        self.accepted = 0
        self._begins: deque[float] = deque(maxlen=_BEGINS)
        self._begun = 0

    def __len__(self) -> int:
        return len(self._messages)

    def put(self, message: Answer) -> bool:
        """Add a message; False where the queue is full."""
        if self._profile.rx_queue == "latest":
            self._drop(len(self))
            self._messages.clear()
        elif len(self) >= self._profile.rx_queue_len:
            return False
        self._messages.append(message)
        self.accepted += 1
        return True

    def take(self) -> Answer | None:
        """Return the message that acts in this cycle, and take the next one from the queue; None for none."""
        self._delayed.append(self._messages.popleft() if self._messages else None)
        return self._delayed.popleft() if len(self._delayed) > self._profile.ref_delay_cycles else None

    def note_begin(self, at: float) -> None:
        """Note when the motion to the next message begins, s; NaN for never."""
        self._begun += 1
        self._begins.append(at)

    def clear(self) -> None:
        """Give up all messages before they act."""
        self._messages.clear()
        self._delayed.clear()
        self._drop(self.accepted - self._begun)

    def _drop(self, count: int) -> None:
        for _ in range(count):
            self.note_begin(math.nan)

    def begun_at(self, target: int) -> float | None:
        """When the motion to a message began, s; None before, NaN for one that did not act or is forgotten."""
        if target > self._begun:
            return None
        kept = self._begun - len(self._begins)
        return self._begins[target - kept - 1] if target > kept else math.nan
