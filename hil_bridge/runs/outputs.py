"""Outputs of a run: their place, whether they can go there, and the part that is printed at the end."""

import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from hil_bridge.clock import wall_time
from hil_bridge.errors import BridgeError, ConfigError
from hil_bridge.record import Recording
from hil_bridge.record.analysis.figures import FIGURES
from hil_bridge.record.analysis.steps import step_lines
from hil_bridge.record.analysis.summary import Summary, summarise, wanted_force
from hil_bridge.record.files import check_place, check_record_place
from hil_bridge.record.reader import dated

if TYPE_CHECKING:
    from hil_bridge.record import RunEnd

RUNS = Path("runs")
"""Folder in which every run has one of its own."""
RECORD, SUMMARY = "run.mcap", "summary.json"
"""Their names in that folder."""
UNNAMED = "default"
"""Stands in a folder's name for the configuration when there is none."""
FREE_BYTES_MIN = 50_000_000
"""Free space without which no recording is begun. Chosen: half an hour of a 1 kHz sensor takes as much."""
_STAMP = re.compile(r"^\d{4}-\d\d-\d\d-\d{4}-\d\d-")
"""Date and time before the name of such a folder."""
_NAME_LENGTH = 80
"""Characters of a configuration's name that a folder is named by. Chosen: file systems take 255 in all."""


@dataclass(frozen=True, slots=True)
class Outputs:
    """Files that a run leaves; None for what is not wanted."""

    record: Path | None = None
    summary: Path | None = None
    report: Path | None = None
    """Folder of the page."""
    overwrite: bool = False
    """Files that are there already may be replaced."""
    own_folder: bool = False
    """A run without a named record goes into a new folder under `RUNS`, and its summary too unless it is named."""
    report_beside: bool = False
    """The report goes into the folder of the record."""
    temporary: bool = False
    """The record goes when the run has ended."""


def settle_outputs(outputs: Outputs, config_file: Path | None) -> Outputs:
    """Return the outputs with every path named and its folder made, before the robot moves.

    Raises ConfigError for what cannot be written afterwards, and for what is there already. `config_file`, or the
    recording that is resumed, is never written over, and no two outputs go into one file.
    """
    beside = None if outputs.record is None else outputs.record.parent
    if outputs.report_beside and beside is None and not outputs.own_folder:
        raise ConfigError(
            "--report without a folder uses that of the recording, but nothing is recorded; give --report a folder"
        )
    if outputs.report_beside and beside is not None:
        outputs = replace(outputs, report=beside)
    _make_folders(outputs)
    _check_apart(outputs, config_file)
    if outputs.record is not None:
        check_record_place(outputs.record, outputs.overwrite)
    for file in (outputs.summary, *_report_files(outputs)):
        if file is not None:
            check_place(file, outputs.overwrite)
    if outputs.record is None and outputs.own_folder:
        folder = _own_folder(_name(config_file))
        return replace(
            outputs,
            record=folder / RECORD,
            summary=outputs.summary or folder / SUMMARY,
            report=folder if outputs.report_beside else outputs.report,
        )
    _check_space(Path(tempfile.gettempdir()) if beside is None else beside)
    return outputs


@contextmanager
def record_path(outputs: Outputs) -> Iterator[Path]:
    """Where the run is recorded; in a temporary folder if it is not kept, for the figures come from it."""
    if outputs.record is not None:
        yield outputs.record
        return
    with tempfile.TemporaryDirectory(prefix="hil-bridge-") as folder:
        yield Path(folder) / RECORD


def write_outputs(
    outputs: Outputs, recorded: Callable[[], Recording], end: "RunEnd"
) -> tuple[list[str], list[BridgeError]]:
    """Write what is wanted beside the record: the lines to print, and what could not be written. `recorded` gives the
    recording, or raises BridgeError.
    """
    lines: list[str] = []
    troubles: list[BridgeError] = []
    try:
        recording = recorded()
        if outputs.record is not None:
            recording = dated(recording, outputs.record)
    except BridgeError as error:
        return lines, [error]
    summary = summarise(recording, end if recording.truncated else None)
    lines += figures(summary)
    if outputs.record is not None:
        lines.append(f"record: {outputs.record}")
    if outputs.summary is not None:
        try:
            summary.write_json(outputs.summary, outputs.overwrite)
            lines.append(f"summary: {outputs.summary}")
        except BridgeError as error:
            troubles.append(error)
    if outputs.report is not None:
        from hil_bridge.show.report import write_report

        try:
            page = write_report(recording, summary, outputs.report, outputs.overwrite)
            lines.append(f"report: {page}")
        except BridgeError as error:
            troubles.append(error)
    return lines, troubles


def figures(summary: Summary) -> list[str]:
    """Return the figures to be shown at once, a line each."""
    tracked, figures = summary.phases_s.get("track", 0.0), summary.figures
    steps = step_lines(summary.steps)
    if not figures:
        return steps
    rows = [("tracked", f"{tracked:.1f} s at {wanted_force(summary)} with {summary.controller}")]
    if summary.force_mean_steady_n is not None:
        rows.append(
            (
                "steady force",
                f"{summary.force_mean_steady_n:.2f} N mean, {figures['steady_peak_to_peak_n']:.2f} N peak to peak",
            )
        )
    elif (swing := figures["steady_peak_to_peak_n"]) is not None:
        mean = figures["steady_mean_error_n"]
        rows.append(("steady error", f"{mean:+.2f} N mean, {swing:.2f} N peak to peak"))
    rise = figures["rise_samples"]
    risen = (
        "not reached" if rise is None else f"{rise:.0f} sample{'s' * (rise != 1)}, {figures['rise_s']:.2f} s"
    )
    if summary.strokes > 1:
        risen += f" in the slowest of {summary.strokes} strokes"
    rows += [
        (FIGURES["rise_samples"].words, risen),
        *(
            (FIGURES[key].words, FIGURES[key].text(figures[key]))
            for key in ("overshoot_percent", "rms_error_n", "contact_losses")
        ),
    ]
    if summary.cycle_time is not None:
        floor = f", {summary.line_floor_s * 1e3:.1f} ms of it the line" if summary.line_floor_s else ""
        rows.append(("cycle time", f"{summary.cycle_time.mean_s * 1e3:.1f} ms mean{floor}"))
    if summary.answers_sentence:
        rows.append(("answers", summary.answers_sentence))
    if summary.latency_sentence:
        rows.append(("latency", summary.latency_sentence))
    return [*steps, *(f"  {name:<15}{text}" for name, text in rows)]


def _report_files(outputs: Outputs) -> Sequence[Path]:
    if outputs.report is None:
        return ()
    from hil_bridge.show.report.page import PAGE

    return [outputs.report / PAGE]


def _make_folders(outputs: Outputs) -> None:
    files = [file for file in (outputs.record, outputs.summary) if file is not None]
    for folder in (*(file.parent for file in files), *filter(None, (outputs.report,))):
        _make(folder)
        if not os.access(folder, os.W_OK | os.X_OK):
            raise ConfigError(f"cannot write into {folder}: no permission; name another place")


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"cannot make the folder {folder}: {error.strerror}; name another place") from error


def _check_apart(outputs: Outputs, config_file: Path | None) -> None:
    """Raise ConfigError where an output would be written over another, or over the file that the run comes from."""
    taken = {} if config_file is None else {config_file.resolve(): _kind(config_file)}
    wanted = [("--record", outputs.record), ("--summary", outputs.summary)]
    wanted += [("--report", file) for file in _report_files(outputs)]
    for option, file in wanted:
        if file is None:
            continue
        place = file.resolve()
        if place in taken:
            raise ConfigError(f"{option} {file} would overwrite {taken[place]}; name another file")
        taken[place] = option


def _name(source: Path | None) -> str:
    """Name of a folder: that of the configuration, or the folder of the recording that is resumed."""
    if source is None:
        return UNNAMED
    return _STAMP.sub("", source.resolve().parent.name) if source.name == RECORD else source.stem


def _kind(source: Path) -> str:
    return "the recording that is resumed" if source.suffix == ".mcap" else "the configuration"


def _own_folder(name: str) -> Path:
    """Make a new folder for a run that begins now, with a counter after its name if it exists. Raises ConfigError."""
    _make(RUNS)
    _check_space(RUNS)
    wanted = f"{wall_time():%Y-%m-%d-%H%M-%S}-{name[:_NAME_LENGTH]}"
    number = 1
    while True:
        folder = RUNS / (wanted if number == 1 else f"{wanted}-{number}")
        try:
            folder.mkdir()
        except FileExistsError:
            number += 1
        except OSError as error:
            raise ConfigError(
                f"cannot make the folder {folder}: {error.strerror}; start elsewhere, or give --record or --no-record"
            ) from error
        else:
            return folder


def _check_space(folder: Path) -> None:
    """Raise ConfigError when the disk of a folder is nearly full."""
    try:
        free = shutil.disk_usage(folder).free
    except OSError as error:
        raise ConfigError(f"cannot write into {folder}: {error.strerror}; name another place") from error
    if free < FREE_BYTES_MIN:
        raise ConfigError(
            f"cannot record into {folder}: {free / 1e6:.0f} MB are free there, {FREE_BYTES_MIN / 1e6:.0f} MB are the "
            "least; make room, or name another place with --record"
        )
