"""Settings of version 0.1.0, which counted cycles, samples and frames, and what stands for each of them now.

A file that holds one is answered with its new name. A recording that holds some is translated, so that it still opens
and is replayed to the bit.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hil_bridge.control.types import SAMPLE_MS

FRAME_MS = 10.0
"""Between two frames of the sensor's default stream, by which version 0.1.0 chose its numbers of frames."""
RECORDED_CYCLE_S = 0.25
"""Time that each cycle of such a recording counts as. Chosen: near to the real time, and a power of two: a speed
times this time is the recorded step to the last bit.
"""


FORCE_LIMIT, PULL_LIMIT = "force_limit_n", "pull_limit_n"


@dataclass(frozen=True, slots=True)
class Renamed:
    """A setting that was counted."""

    key: str
    """New name of the key, `section.name`."""
    frames: bool = False
    """The old setting counted frames, not cycles."""
    reached: bool = True
    """For a count: the run reacted at that count, not after it."""

    @property
    def is_speed(self) -> bool:
        """It was mm in a cycle and is mm/s; else it was a count and is a time in ms."""
        return self.key.endswith("_mm_s")

    def value(self, before: float, cycle_ms: float) -> float:
        """The old value with cycles of this time."""
        if self.is_speed:
            return before / (cycle_ms * 1e-3)
        # cycles are not evenly long: half of one less is reached by the same one
        return (before - 0.5 * self.reached) * (FRAME_MS if self.frames else cycle_ms)


_TABLE = re.compile(r"\s*\[\s*([\w.]+)\s*\]")
_NUMBER = re.compile(r"(\s*#?\s*)(\w+)(\s*=\s*)([-+]?[\d_.]+(?:[eE][-+]?\d+)?)(.*)")
"""A key and its number, in use or commented out: indent, key, equals sign, value, rest."""

RENAMED: Mapping[str, Renamed] = {
    "task.step_mm": Renamed("task.speed_mm_s"),
    "task.approach_step_mm": Renamed("task.approach_speed_mm_s"),
    "task.retract_step_mm": Renamed("task.retract_speed_mm_s"),
    "task.loss_samples": Renamed("task.loss_ms"),
    "limits.correction_per_cycle_mm": Renamed("limits.correction_mm_s"),
    "limits.travel_per_cycle_mm": Renamed("limits.travel_mm_s"),
    "limits.frozen_after_frames": Renamed("limits.frozen_after_ms", frames=True),
    "limits.still_after_cycles": Renamed("limits.still_after_ms"),
    "oscillation.window_samples": Renamed("oscillation.window_ms", reached=False),
}
"""Replacements by the old name."""


def told_of(key: str, value: object) -> str:
    """Replacement for an old setting, with its value at the S3's 180 ms; empty for a key that is none."""
    renamed = RENAMED.get(key)
    if renamed is None:
        return ""
    kind = "speed" if renamed.is_speed else "time"
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        return f" is now a {kind}: {renamed.key}"
    cycle = f"a frame every {FRAME_MS:g} ms" if renamed.frames else f"a cycle of {SAMPLE_MS:g} ms"
    return f" is now a {kind}: {renamed.key} = {renamed.value(value, SAMPLE_MS):.4g} is the same with {cycle}"


def upgraded(text: str) -> tuple[str, list[str]]:
    """A configuration file of version 0.1.0 with the settings of now, its comments kept, and each change in words.

    Values are those for the S3's 180 ms and for a frame every 10 ms, as `told_of` says.
    """
    section, lines, changes = "", [], []
    for line in text.splitlines():
        if table := _TABLE.match(line):
            section = table[1]
        found = _NUMBER.match(line)
        renamed = RENAMED.get(f"{section}.{found[2]}") if found else None
        if found and renamed:
            key = renamed.key.partition(".")[2]
            value = f"{renamed.value(float(found[4].replace('_', '')), SAMPLE_MS):.4g}"
            line = f"{found[1]}{key}{found[3]}{value}{found[5]}"
            changes.append(f"{section}.{found[2]} = {found[4]} is now {renamed.key} = {value}")
        lines.append(line)
    return "\n".join(lines) + "\n", changes


def is_counted(recorded: object) -> bool:
    """Whether a recorded configuration counts cycles, as those of version 0.1.0 do."""
    return any(
        _section(recorded, key.partition(".")[0]).get(key.partition(".")[2]) is not None for key in RENAMED
    )


def translated(recorded: Mapping[str, Any]) -> Mapping[str, Any]:
    """A recorded configuration with the settings of now, where its cycles count as `RECORDED_CYCLE_S`.

    A run without a limit for pulls stopped at the limit of force in both directions.
    """
    limits = _section(recorded, "limits")
    if FORCE_LIMIT in limits and PULL_LIMIT not in limits:
        recorded = {**recorded, "limits": {**limits, PULL_LIMIT: limits[FORCE_LIMIT]}}
    if not is_counted(recorded):
        return recorded
    result: dict[str, Any] = dict(recorded)
    for old, renamed in RENAMED.items():
        section, _, name = old.partition(".")
        table = dict(_section(result, section))
        value = table.pop(name, None)
        if isinstance(value, (int, float)):
            table[renamed.key.partition(".")[2]] = renamed.value(value, RECORDED_CYCLE_S * 1e3)
        if section in result:
            result[section] = table
    return result


def _section(values: object, name: str) -> Mapping[str, Any]:
    table = values.get(name) if isinstance(values, Mapping) else None
    return table if isinstance(table, Mapping) else {}
