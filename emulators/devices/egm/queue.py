"""Queue of a client's messages, and their delay until a controller with EGM moves."""

from collections import deque

from emulators.devices.egm.profile import EgmProfile
from emulators.target_times import TargetTimes
from protocol.devices.egm import Answer


class MessageQueue:
    """Accepted messages, and the times at which they take effect."""

    def __init__(self, profile: EgmProfile) -> None:
        self._profile = profile
        self._messages: deque[Answer] = deque()
        self._delayed: deque[Answer | None] = deque()
        """Message taken from the queue in each of the last cycles; None for a cycle in which the queue was empty."""
        self.targets = TargetTimes()

    def __len__(self) -> int:
        return len(self._messages)

    def put(self, message: Answer, now: float) -> bool:
        """Add a message at the time `now`, s. Return False if the queue is full."""
        if self._profile.rx_queue == "latest":
            self.targets.drop(len(self))
            self._messages.clear()
        elif len(self) >= self._profile.rx_queue_len:
            return False
        self._messages.append(message)
        self.targets.accept(now)
        return True

    def take(self) -> Answer | None:
        """Return the message that takes effect in this cycle, or None. Also take the next message
        from the queue.
        """
        self._delayed.append(self._messages.popleft() if self._messages else None)
        return self._delayed.popleft() if len(self._delayed) > self._profile.ref_delay_cycles else None

    def clear(self) -> None:
        """Discard all messages that have not taken effect."""
        self._messages.clear()
        self._delayed.clear()
        self.targets.drop()
