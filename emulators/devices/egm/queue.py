"""Queue of a client's messages, and their delay until a controller with EGM moves."""

import math
from collections import deque

from emulators.devices.egm.profile import EgmProfile
from protocol.devices.egm import Answer

_BEGINS = 256
"""Number of stored start times of motions. Chosen."""


class MessageQueue:
    """Accepted messages, and the times at which they take effect."""

    def __init__(self, profile: EgmProfile) -> None:
        self._profile = profile
        self._messages: deque[Answer] = deque()
        self._delayed: deque[Answer | None] = deque()
        """Message taken from the queue in each of the last cycles; None for a cycle in which the queue was empty."""
        self.accepted = 0
        self._begins: deque[float] = deque(maxlen=_BEGINS)
        self._begun = 0

    def __len__(self) -> int:
        return len(self._messages)

    def put(self, message: Answer) -> bool:
        """Add a message. Return False if the queue is full."""
        if self._profile.rx_queue == "latest":
            self._drop(len(self))
            self._messages.clear()
        elif len(self) >= self._profile.rx_queue_len:
            return False
        self._messages.append(message)
        self.accepted += 1
        return True

    def take(self) -> Answer | None:
        """Return the message that takes effect in this cycle, or None if there is none. Also take the next message
        from the queue.
        """
        self._delayed.append(self._messages.popleft() if self._messages else None)
        return self._delayed.popleft() if len(self._delayed) > self._profile.ref_delay_cycles else None

    def note_begin(self, at: float) -> None:
        """Store the time at which the motion to the next message begins, s; NaN if it never begins."""
        self._begun += 1
        self._begins.append(at)

    def clear(self) -> None:
        """Discard all messages that have not taken effect."""
        self._messages.clear()
        self._delayed.clear()
        self._drop(self.accepted - self._begun)

    def _drop(self, count: int) -> None:
        for _ in range(count):
            self.note_begin(math.nan)

    def begun_at(self, target: int) -> float | None:
        """Return the time at which the motion to a message began, s.

        It is None if the motion has not begun, and NaN if the message has no effect or is no longer stored.
        """
        if target > self._begun:
            return None
        kept = self._begun - len(self._begins)
        return self._begins[target - kept - 1] if target > kept else math.nan
