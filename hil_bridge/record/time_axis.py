"""Times of each record on the time axis of its run, for a file and for Foxglove clients."""

import math
from collections.abc import Callable
from typing import NamedTuple

from hil_bridge.record.topics import Record, Topic

ORDER_WINDOW_S = 10.0
"""Longest time by which successive log times in a file may decrease, s.

Chosen: twice the time that the ground truth of an emulated cell waits for a cycle.
"""


class Placed(NamedTuple):
    """Record with its times."""

    record: Record
    """Record with a finite time."""
    at: float
    """Time of the record on the run's clock, s."""
    log_ns: int
    """Log time, ns since the Unix epoch."""


class TimeAxis:
    """Time axis of one run, which stores the newest time."""

    def __init__(self, wall_ns: Callable[[float], int]) -> None:
        """`wall_ns` converts a time on the run's clock to ns since the Unix epoch."""
        self.newest = 0.0
        """Newest time of a record so far, s."""
        self._wall_ns = wall_ns

    def place(self, topic: Topic, record: Record) -> Placed:
        """Return the next record with its times. A record without a finite time gets the newest time.

        The log time of a record is never more than ORDER_WINDOW_S before the newest time.
        """
        at = topic.time_of(record)
        if not math.isfinite(at):
            at = self.newest
            record = topic.timed(record, at)
        self.newest = max(self.newest, at)
        return Placed(record, at, self._wall_ns(max(at, self.newest - ORDER_WINDOW_S)))
