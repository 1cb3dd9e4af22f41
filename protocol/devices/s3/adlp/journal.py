"""Queue of a link's events for its owner, and the link's counters."""

from collections import deque
from collections.abc import Mapping
from enum import StrEnum
from types import MappingProxyType

from protocol.devices.s3.adlp.events import ROUTINE, LinkEvent, LinkNotice, NoticeKind

EVENT_LIMIT = 1024
"""Maximum number of queued events. Beyond this limit, the oldest event is dropped and counted. Mark: chosen."""


class Count(StrEnum):
    """Counter that does not belong to a notice."""

    MESSAGES_SENT = "messages sent"
    MESSAGES_RECEIVED = "messages received"
    MESSAGES_FAILED = "messages failed"
    BLOCKS_SENT = "blocks sent"
    BLOCKS_RECEIVED = "blocks received"
    NOISE_BYTES = "noise bytes"
    EVENTS_DROPPED = "events dropped"


class Journal:
    """Bounded queue of events, with a counter for each `Count` and `NoticeKind`."""

    def __init__(self) -> None:
        self._events: deque[LinkEvent] = deque()
        self._counts: dict[str, int] = {str(name): 0 for name in (*Count, *NoticeKind)}
        self.counters: Mapping[str, int] = MappingProxyType(self._counts)
        """Totals by the text of the counter, as a live read-only view."""
        self.verbose = False
        """Whether `ROUTINE` notices are reported in addition to being counted."""

    def next_event(self) -> LinkEvent | None:
        """Return the oldest event not yet taken, or None."""
        return self._events.popleft() if self._events else None

    def count(self, name: Count, number: int = 1) -> None:
        """Increase a counter."""
        self._counts[name] += number

    def tell(self, event: LinkEvent, count: Count) -> None:
        """Queue an event and count it."""
        self._counts[count] += 1
        self._keep(event)

    def notice(self, kind: NoticeKind, text: str) -> None:
        """Count a notice, and queue it unless it is routine and the link is not verbose."""
        self._counts[kind] += 1
        if self.verbose or kind not in ROUTINE:
            self._keep(LinkNotice(kind, text))

    def _keep(self, event: LinkEvent) -> None:
        if len(self._events) >= EVENT_LIMIT:
            self._events.popleft()
            self._counts[Count.EVENTS_DROPPED] += 1
        self._events.append(event)
