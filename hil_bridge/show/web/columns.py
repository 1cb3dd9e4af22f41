"""Columns of a run for the charts and the sketch of its page, thinned so that a fast robot fills no browser."""

import math
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

from hil_bridge.record.records import CycleRecord, TruthRecord

ROW_S = 0.02
"""Shortest time between two rows of a live page. Chosen: two a picture."""
ROWS = 6000
"""Rows that are kept of a live run: two minutes of a fast robot. Chosen."""
MILLI = 1e3

CYCLE = (
    *("x", "force", "low", "high", "target", "lateral", "mx", "my", "mz", "depth", "commanded", "stiffness"),
    *("cycle", "answer", "age", "px", "py", "pz", "travel", "touch"),
)
TRUTH = ("x", "force", "depth", "px", "py", "pz")
Row: TypeAlias = Sequence[float | None]
Rows: TypeAlias = Mapping[str, list[float | None]]


class Columns:
    """Rows of cycles and of the truth. Their numbers rise by one, also when old rows are gone."""

    def __init__(self, began: float, row_s: float = ROW_S, most: int | None = ROWS) -> None:
        """`began` is the time of the run's clock at x = 0. `most` None keeps all rows."""
        self._began = began
        self._row_s = row_s
        self._rows: dict[str, deque[Row]] = {"cycle": deque(maxlen=most), "truth": deque(maxlen=most)}
        self._counts = {"cycle": 0, "truth": 0}
        self._due = {"cycle": -math.inf, "truth": -math.inf}
        self._low, self._high = math.inf, -math.inf
        self._before: float | None = None
        self._start: Sequence[float] = (0.0, 0.0, 0.0)
        self.approach: Sequence[float] | None = None
        """Unit vector of the approach in the base frame, once a cycle told it: the tool's z axis at the start."""

    @property
    def counts(self) -> Mapping[str, int]:
        """Number of rows so far, by table."""
        return dict(self._counts)

    def cycle(self, record: CycleRecord) -> None:
        """Take a cycle. Between two rows the least and the greatest force are kept."""
        if math.isfinite(record.force):
            self._low, self._high = min(self._low, record.force), max(self._high, record.force)
        self._start = record.start
        if self.approach is None:
            self.approach = axis_z(record.quaternion)
        period = None if self._before is None else record.started_at - self._before
        self._before = record.started_at
        at = record.controlled_at
        if not math.isfinite(at) or at < self._due["cycle"]:
            return
        force = record.force
        across = math.sqrt(max(0.0, math.hypot(*record.wrench[:3]) ** 2 - force * force))
        self._add(
            "cycle",
            at,
            (
                at - self._began,
                force,
                self._low,
                self._high,
                record.force_reference,
                across,
                *record.wrench[3:],
                record.depth * MILLI,
                record.depth_commanded * MILLI,
                record.stiffness,
                None if period is None else period * MILLI,
                record.answer_s * MILLI,
                (at - record.sensor_at) * MILLI,
                *self._place(record.position),
                record.travel_commanded * MILLI,
                float(record.in_contact),
            ),
        )
        self._low, self._high = math.inf, -math.inf

    def truth(self, record: TruthRecord) -> None:
        """Take the truth of a cycle."""
        if self.approach is None or not math.isfinite(record.at) or record.at < self._due["truth"]:
            return
        place = self._place(record.position)
        depth = sum(a * b for a, b in zip(place, self.approach, strict=True))
        force = -sum(a * b for a, b in zip(record.force, self.approach, strict=True))
        self._add("truth", record.at, (record.at - self._began, force, depth, *place))

    def _place(self, position: Sequence[float]) -> list[float]:
        """From the start point, base frame, mm."""
        return [(one - start) * MILLI for one, start in zip(position, self._start, strict=True)]

    def _add(self, table: str, at: float, row: Row) -> None:
        self._due[table] = (
            at + self._row_s * 0.999
        )  # a time that is one row later may be so by its last digits less
        self._rows[table].append(tuple(None if value is None else tidy(value) for value in row))
        self._counts[table] += 1

    def since(self, counts: Mapping[str, int]) -> dict[str, Rows]:
        """Rows after these numbers, as columns by table; tables without new rows are left out."""
        found: dict[str, Rows] = {}
        for table, names in (("cycle", CYCLE), ("truth", TRUTH)):
            new = min(self._counts[table] - counts.get(table, 0), len(self._rows[table]))
            if new > 0:
                rows = self._rows[table]
                chosen = [rows[k] for k in range(len(rows) - new, len(rows))]
                found[table] = dict(zip(names, map(list, zip(*chosen, strict=True)), strict=True))
        return found


def tidy(value: float) -> float | None:
    """A number with six digits, which a page cannot tell from all of them; None for one that is not finite."""
    return float(f"{value:.6g}") if math.isfinite(value) else None


def axis_z(quaternion: Sequence[float]) -> Any:
    """The third axis of a frame in its base: w x y z."""
    w, x, y, z = quaternion
    return 2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)
