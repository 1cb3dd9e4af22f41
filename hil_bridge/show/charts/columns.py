"""Columns of a run's charts, filled from a recording, or record by record during a run."""

import math
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hil_bridge.record.analysis.strokes import TRACK
from hil_bridge.record.reader import Recording
from hil_bridge.record.records import CycleRecord, TruthRecord
from hil_bridge.show.charts.facts import ChartFacts
from hil_bridge.show.charts.surface import deflection_um, tilt_deg, touches
from protocol.geometry import rotate, tool_axis

ROW_S = 0.04
"""Shortest time between two rows of a live page, s. Chosen: one video frame."""
ROWS = 6000
"""Maximum number of rows that are kept of a live run. Chosen: two minutes of a fast robot."""
MILLI = 1e3
LEVELS = {"level_error": "error", "level_change": "change", "level_output": "output"}
"""Names of a fuzzy controller's levels, by their keys in a cycle's explanation."""
FEED, SIGMA, NORMALS = "feed", "normal_sigma_deg", ("normal_x_deg", "normal_y_deg")
"""Keys that a program adds to the explanation of a cycle."""
_LEAST_TILT_DEG = 0.01
"""Tilt below which the tool axis counts as parallel to the normal, °. Chosen: the rounding error."""

PLACE = ("position_x", "position_y", "position_z")
TURN = ("turn_w", "turn_x", "turn_y", "turn_z")
PUSH = ("force_x", "force_y", "force_z")
JOINTS = tuple(f"joint_{number}" for number in range(1, 7))
SPACE = (*PLACE, *TURN, *PUSH)
"""Position, orientation and force in space: base frame, mm and N."""
CYCLE = (
    *("x", "force", "force_reference", "clamped", "wrench_fx", "wrench_fy", "lateral", "resultant"),
    *("wrench_mx", "wrench_my", "wrench_mz", "moment"),
    *("depth", "depth_commanded", "travel_commanded", "across_commanded", "correction", "rests", *LEVELS),
    *("stiffness", "gain"),
    *("cycle_ms", "age_ms", "answer_ms", FEED, SIGMA),
    *(f"{name}{end}" for name in NORMALS for end in ("", "_low", "_high")),
    *(*SPACE, "in_contact"),
)
TRUTH = ("x", "force", "depth", *SPACE, *JOINTS, "tilt", "tilt_touching", "deflection", "deflection_across")
TABLES = {"cycle": CYCLE, "truth": TRUTH}
_FORCE = CYCLE.index("force")
Value: TypeAlias = float | None
Row: TypeAlias = Sequence[Value]
Rows: TypeAlias = Mapping[str, list[Value]]
Arrays: TypeAlias = Mapping[str, NDArray[np.float64]]


class Columns:
    """Rows of cycles and of the ground truth. Row numbers increase by one, even after old rows have been dropped."""

    def __init__(
        self, began: float, facts: ChartFacts, row_s: float = ROW_S, most: int | None = ROWS
    ) -> None:
        """`began` is the time on the run's clock at x = 0, and `most` is the maximum number of rows (None:
        unlimited).

        Rows are at least `row_s` apart, except for the rows with the smallest and largest force in between, so no
        peak is lost.
        """
        self._began = began
        self._facts = facts
        self._row_s = row_s
        self._rows: dict[str, deque[Row]] = {table: deque(maxlen=most) for table in TABLES}
        self._counts = dict.fromkeys(TABLES, 0)
        self._due = dict.fromkeys(TABLES, -math.inf)
        self._skipped: list[Row] = []
        self._before: float | None = None
        self.start: Sequence[float] = (0.0, 0.0, 0.0)
        """Position of the start point, base frame, m, to which the positions of the rows are relative."""
        self.approach: Sequence[float] | None = facts.approach
        """Unit vector of the approach in the base frame; None until known."""

    @classmethod
    def of(cls, recording: Recording, began: float, facts: ChartFacts, row_s: float = 0.0) -> Self:
        """Return the columns of a complete recording."""
        columns = cls(began, facts, row_s, None)
        for cycle in recording.cycles:
            columns.cycle(cycle)
        for truth in recording.truths:
            columns.truth(truth)
        return columns

    @property
    def counts(self) -> Mapping[str, int]:
        """Number of rows so far, by table."""
        return dict(self._counts)

    def cycle(self, record: CycleRecord) -> None:
        """Add a cycle."""
        self.start = record.start
        if self.approach is None:
            self.approach = tool_axis(record.sample.quaternion)
        before, self._before = self._before, record.started_at
        at = record.controlled_at
        if not math.isfinite(at):
            return
        seconds = (
            record.answered_at - record.started_at
            if self._facts.robot.cycle_s is None
            else math.nan
            if before is None
            else record.started_at - before
        )
        row = self._cycle_row(record, seconds)
        if at < self._due["cycle"]:
            self._skipped.append(row)
            return
        for extreme in self._extremes(row):
            self._add("cycle", extreme)
        self._due["cycle"] = (
            at + self._row_s * 0.999
        )  # rounding may decrease the time of the next row in its last digits
        self._skipped.clear()
        self._add("cycle", row)

    def frame(self, at: float, force: float, after: float) -> None:
        """Add the force along the approach in a sensor frame that no cycle uses, if it arrived after `after`, s."""
        rows = self._rows["cycle"]
        if at > after and rows and at - self._began > _number(rows[-1][0]):
            self._add("cycle", (at - self._began, force, *[None] * (len(CYCLE) - 2)))

    def _extremes(self, after: Row) -> list[Row]:
        """Return the skipped rows with the smallest and largest force.

        Rows within the range of the neighbouring rows are omitted.
        """
        forces = [value for row in self._skipped if math.isfinite(value := _number(row[_FORCE]))]
        if not forces:
            return []
        kept = [_number(after[_FORCE])]
        if self._rows["cycle"]:
            kept.append(_number(self._rows["cycle"][-1][_FORCE]))
        beyond = {value for value in (min(forces), max(forces)) if value < min(kept) or value > max(kept)}
        extremes = []
        for row in self._skipped:
            if _number(row[_FORCE]) in beyond:
                beyond.discard(_number(row[_FORCE]))
                extremes.append(row)
        return extremes

    def _cycle_row(self, record: CycleRecord, seconds: float) -> Row:
        force, explained = record.force, record.explanation
        fx, fy, fz, mx, my, mz = record.sample.wrench
        resultant = math.hypot(fx, fy, fz)
        presses = record.phase == TRACK and math.isfinite(force)
        sigma = explained.get(SIGMA, math.nan) if presses else math.nan
        normals = [explained.get(name, math.nan) if presses else math.nan for name in NORMALS]
        full_feed = 1.0 if record.phase == TRACK and record.step in self._facts.tracks else math.nan
        return (
            record.controlled_at - self._began,
            force,
            record.force_reference if record.phase == TRACK else None,
            force if record.verdict == "clamp" else None,
            fx,
            fy,
            math.sqrt(max(0.0, resultant**2 - force**2)),
            resultant,
            mx,
            my,
            mz,
            math.hypot(mx, my, mz),
            record.depth * MILLI,
            record.depth_commanded * MILLI,
            record.travel_commanded * MILLI,
            record.across_commanded * MILLI,
            record.correction * MILLI,
            0.0 if record.held else None,
            *(explained.get(key) for key in LEVELS),
            record.stiffness if record.stiffness is not None and record.stiffness > 0.0 else None,
            record.gain,
            seconds * MILLI,
            (record.controlled_at - record.sample.sensor_at) * MILLI,
            record.answer_s * MILLI,
            100.0 * explained.get(FEED, full_feed),
            sigma,
            *(value for normal in normals for value in (normal, normal - 2 * sigma, normal + 2 * sigma)),
            *self._place(record.sample.position),
            *record.sample.quaternion,
            *rotate(record.sample.quaternion, (fx, fy, fz)),
            float(record.in_contact),
        )

    def truth(self, record: TruthRecord) -> None:
        """Add the ground truth of a cycle."""
        if self.approach is None or not math.isfinite(record.at) or record.at < self._due["truth"]:
            return
        place = self._place(record.position)
        depth = sum(a * b for a, b in zip(place, self.approach, strict=True))
        force = -sum(a * b for a, b in zip(record.force, self.approach, strict=True))
        tilt = tilt_deg(record)
        tipped = None if tilt is None or tilt <= _LEAST_TILT_DEG else tilt
        self._due["truth"] = record.at + self._row_s * 0.999
        self._add(
            "truth",
            (
                *(record.at - self._began, force, depth),
                *(*place, *record.quaternion, *record.force, *record.joints_deg),
                *(tipped, tipped if touches(record) else None),
                *deflection_um(record, self.approach),
            ),
        )

    def _place(self, position: Sequence[float]) -> list[float]:
        """Return the position relative to the start point, base frame, mm."""
        return [(one - start) * MILLI for one, start in zip(position, self.start, strict=True)]

    def _add(self, table: str, row: Row) -> None:
        self._rows[table].append(row)
        self._counts[table] += 1

    def since(self, counts: Mapping[str, int]) -> dict[str, Rows]:
        """Return the rows after these row numbers, as columns by table; tables without new rows are omitted."""
        tables: dict[str, Rows] = {}
        for table, names in TABLES.items():
            new = min(self._counts[table] - counts.get(table, 0), len(self._rows[table]))
            if new > 0:
                rows = self._rows[table]
                chosen = [rows[k] for k in range(len(rows) - new, len(rows))]
                columns = (
                    [None if v is None else round_digits(v) for v in values]
                    for values in zip(*chosen, strict=True)
                )
                tables[table] = dict(zip(names, columns, strict=True))
        return tables

    def arrays(self) -> dict[str, Arrays]:
        """Return all rows as arrays by table, with NaN for missing values; tables without rows are omitted."""
        return {
            table: dict(zip(names, np.array(self._rows[table], dtype=np.float64).T, strict=True))
            for table, names in TABLES.items()
            if self._rows[table]
        }


def _number(value: Value) -> float:
    return math.nan if value is None else value


def round_digits(value: float) -> float | None:
    """Round a number to six digits, which is more than a page resolves; return None if it is not finite."""
    return float(f"{value:.6g}") if math.isfinite(value) else None
