"""The runs of a folder, by the summaries that they left."""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from hil_bridge.errors import ConfigError
from hil_bridge.errors.text_files import harmless
from hil_bridge.record.analysis.figures import FIGURES, UNKNOWN

_SUMMARY, _RECORDING = "summary.json", "*.mcap"
_LARGEST = 1_000_000
"""Chosen: bytes of a summary that are read; ours have a few thousand."""
_SHOWN = ("rms_error_n", "largest_force_n")


class ListedRun(NamedTuple):
    """A folder with a run."""

    path: Path
    summary: Mapping[str, Any]
    """Empty where the run left none that can be read."""

    @property
    def values(self) -> Mapping[str, Any]:
        """The columns of the list, by name."""
        figures = self.summary.get("figures")
        known = figures if isinstance(figures, dict) else {}
        return {
            "run": str(self.path),
            **{key: self.summary.get(key) for key in ("outcome", "controller", "cause", "text", "left")},
            **{key: known.get(key) for key in _SHOWN},
        }


def list_runs(folder: Path, last: int) -> Sequence[ListedRun]:
    """Return the newest runs of a folder, oldest first: their names begin with their times. Raises ConfigError."""
    try:
        there = sorted(path for path in folder.iterdir() if path.is_dir())
    except OSError as error:
        raise ConfigError(
            f"{folder}: {error.strerror or error}; name the folder in which runs lie"
        ) from error
    found = [path for path in there if (path / _SUMMARY).is_file() or any(path.glob(_RECORDING))]
    return [ListedRun(path, _read(path / _SUMMARY)) for path in found[-last:]]


def run_lines(runs: Sequence[ListedRun]) -> Iterator[str]:
    """Return a table for people to read."""
    if not runs:
        yield "no runs: each is a folder with the summary.json that `hil-bridge run` writes"
        return
    rows = [("run", "outcome", "controller", *(FIGURES[key].title for key in _SHOWN), "cause")]
    rows += [_row(run.values) for run in runs]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        yield "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip()


def _row(values: Mapping[str, Any]) -> tuple[str, ...]:
    figures = [values[key] for key in _SHOWN]
    numbers = [f"{one:.2f}" if isinstance(one, int | float) else UNKNOWN for one in figures]
    words = [str(values[key] or UNKNOWN) for key in ("run", "outcome", "controller")]
    return tuple(map(harmless, (*words, *numbers, str(values["text"] or ""))))


def _read(path: Path) -> Mapping[str, Any]:
    """Read a summary; empty for one that cannot be read: another program may have written it."""
    try:
        with path.open("rb") as file:
            found = json.loads(file.read(_LARGEST))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}
