"""The place of each record on the time axis of its run, for a file and for Foxglove's clients."""

import math
from collections.abc import Callable
from typing import NamedTuple

from hil_bridge.record.topics import Record, Topic

ORDER_WINDOW_S = 10.0
"""How far the log times of a file may fall, s. Chosen: twice what the truth of an emulated cell waits for a cycle."""


class Placed(NamedTuple):
    """A record with its times."""

    record: Record
    """Its own time is finite."""
    at: float
    """Time of the record on the run's clock, s."""
    log_ns: int
    """Log time, ns since the Unix epoch."""


class TimeAxis:
    """The axis of one run. It knows the newest time."""

    def __init__(self, wall_ns: Callable[[float], int]) -> None:
        """`wall_ns` turns a time of the run's clock into ns since the Unix epoch."""
        self.newest = 0.0
        """The newest time of a record so far, s."""
        self._wall_ns = wall_ns

    def place(self, topic: Topic, record: Record) -> Placed:
        """Place one more record. One without a finite time takes the newest: of no device that tells the truth.

        Its log time is never more than ORDER_WINDOW_S before the newest.
        """
        at = topic.time_of(record)
        if not math.isfinite(at):
            at = self.newest
            record = topic.timed(record, at)
        self.newest = max(self.newest, at)
        return Placed(record, at, self._wall_ns(max(at, self.newest - ORDER_WINDOW_S)))
