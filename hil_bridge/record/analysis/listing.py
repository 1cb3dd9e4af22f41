"""Runs of a folder, listed by their summaries."""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from hil_bridge.errors import ConfigError
from hil_bridge.errors.text_files import harmless
from hil_bridge.record.analysis.definition import UNKNOWN
from hil_bridge.record.analysis.figures import FIGURES

_SUMMARY, _RECORDING = "summary.json", "*.mcap"
_LARGEST = 1_000_000
"""Maximum number of bytes that are read from a summary. Chosen: a normal summary has a few thousand."""
_SHOWN = ("rms_error_n", "largest_force_n")


class ListedRun(NamedTuple):
    """Folder that holds a run."""

    path: Path
    summary: Mapping[str, Any]
    """Contents of the run's summary; empty if the run has no readable summary."""

    @property
    def values(self) -> Mapping[str, Any]:
        """Values of the columns of the list, by name."""
        figures = self.summary.get("figures")
        known = figures if isinstance(figures, dict) else {}
        return {
            "run": str(self.path),
            **{key: self.summary.get(key) for key in ("outcome", "controller", "cause", "text", "left")},
            **{key: known.get(key) for key in _SHOWN},
        }


def list_runs(folder: Path, last: int) -> Sequence[ListedRun]:
    """Return the newest runs of a folder, oldest first.

    Folder names begin with the date and time. Raises ConfigError.
    """
    try:
        there = sorted(path for path in folder.iterdir() if path.is_dir())
    except OSError as error:
        raise ConfigError(
            f"{folder}: {error.strerror or error}; name the folder that contains the runs"
        ) from error
    run_folders = [path for path in there if (path / _SUMMARY).is_file() or any(path.glob(_RECORDING))]
    return [ListedRun(path, _read(path / _SUMMARY)) for path in run_folders[-last:]]


def run_lines(runs: Sequence[ListedRun]) -> Iterator[str]:
    """Return the runs as the lines of a table."""
    if not runs:
        yield "no runs: a run is a folder with the summary.json that `hil-bridge run` writes"
        return
    rows = [("run", "outcome", "controller", *(FIGURES[key].title for key in _SHOWN), "cause")]
    rows += [_row(run.values) for run in runs]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        yield "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip()


def _row(values: Mapping[str, Any]) -> tuple[str, ...]:
    figures = [values[key] for key in _SHOWN]
    numbers = [f"{one:.2f}" if isinstance(one, int | float) else UNKNOWN for one in figures]
    texts = [str(values[key] or UNKNOWN) for key in ("run", "outcome", "controller")]
    return tuple(map(harmless, (*texts, *numbers, str(values["text"] or ""))))


def _read(path: Path) -> Mapping[str, Any]:
    """Read a summary; return an empty mapping if it is unreadable, because another program may have written it."""
    try:
        with path.open("rb") as file:
            summary = json.loads(file.read(_LARGEST))
    except (OSError, ValueError):
        return {}
    return summary if isinstance(summary, dict) else {}
