"""Outputs of a run: their paths, the check that they can be written, and the figures that are printed at the end."""

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
from hil_bridge.errors.text_files import format_path
from hil_bridge.record import Recording
from hil_bridge.record.analysis.figures import FIGURES
from hil_bridge.record.analysis.steps import step_lines
from hil_bridge.record.analysis.summary import Summary, summarise, target_force_text
from hil_bridge.record.files import check_place, check_record_path
from hil_bridge.record.next_commands import RunPlaces
from hil_bridge.record.reader import with_file
from hil_bridge.settings.configuration import Config, load_config

if TYPE_CHECKING:
    from hil_bridge.record import RunEnd

RUNS = Path("runs")
"""Folder that contains one subfolder per run."""
RECORD, SUMMARY = "run.mcap", "summary.json"
"""File names of recording and summary in the folder of a run."""
UNNAMED = "default"
"""Text that replaces the configuration's name in a folder's name if there is no name."""
FREE_BYTES_MIN = 50_000_000
"""Minimum free space to start a recording, bytes. Chosen: half an hour with a 1 kHz sensor takes this much."""
_OPERATORS_FILE = "CONFIG.toml"
"""Placeholder for a configuration that the operator has to name."""
_STAMP = re.compile(r"^\d{4}-\d\d-\d\d-\d{4}-\d\d-")
"""Pattern of the date and time at the start of a run folder's name."""
_NAME_LENGTH = 80
"""Maximum number of characters of a configuration's name in a folder's name. Chosen: file systems allow 255 in
total.
"""


@dataclass(frozen=True, slots=True)
class Outputs:
    """Output files of a run. A file that is not requested is None."""

    record: Path | None = None
    summary: Path | None = None
    report: Path | None = None
    """Folder of the report."""
    overwrite: bool = False
    """Whether existing files may be overwritten."""
    own_folder: bool = False
    """Whether a run without a named recording is written to a new folder under `RUNS`. Its summary is written there
    too, unless the summary is named.
    """
    report_with_record: bool = False
    """Whether the report is written into the folder of the recording."""
    temporary: bool = False
    """Whether the recording is deleted after the run."""

    @property
    def only_figures(self) -> bool:
        """Whether only figures of the run are kept, neither its recording nor a report."""
        return self.temporary and self.report is None


def settle_outputs(outputs: Outputs, config_file: Path | None) -> Outputs:
    """Return the outputs with all paths resolved and their folders created, before the robot moves.

    Raises ConfigError for a path that cannot be written later, or for an existing file. `config_file`, or the
    recording that is resumed, is never overwritten, and no two outputs use the same file.
    """
    record_folder = None if outputs.record is None else outputs.record.parent
    if outputs.report_with_record and record_folder is None and not outputs.own_folder:
        raise ConfigError(
            "--report without a folder uses that of the recording, but nothing is recorded; give --report a folder"
        )
    if outputs.report_with_record and record_folder is not None:
        outputs = replace(outputs, report=record_folder)
    _make_folders(outputs)
    _check_apart(outputs, config_file)
    if outputs.record is not None:
        check_record_path(outputs.record, outputs.overwrite)
    for file in (outputs.summary, *_report_files(outputs)):
        if file is not None:
            check_place(file, outputs.overwrite)
    if outputs.record is None and outputs.own_folder:
        folder = _own_folder(_name(config_file))
        return replace(
            outputs,
            record=folder / RECORD,
            summary=outputs.summary or folder / SUMMARY,
            report=folder if outputs.report_with_record else outputs.report,
        )
    _check_space(Path(tempfile.gettempdir()) if record_folder is None else record_folder)
    return outputs


def run_places(config: Config, outputs: Outputs, config_file: Path | None) -> RunPlaces:
    """Return where a run leaves its recording, and how `hil-bridge free` reaches its tool afterwards."""
    record = "" if outputs.temporary or outputs.record is None else format_path(outputs.record)
    return RunPlaces(record, outputs.report is not None, _free_arguments(config, config_file))


def _free_arguments(config: Config, config_file: Path | None) -> tuple[str, ...]:
    """Return the arguments with which `hil-bridge free` uses the settings of a run; empty for an emulated cell, which
    ends with its run.
    """
    if not (config.robot.url and config.sensor.url):
        return ()
    file = config_file if config_file is not None and config_file.suffix != ".mcap" else None
    try:
        known = load_config(file, {})
    except ConfigError:  # the file has changed since
        return (_OPERATORS_FILE,)
    if (known.frame, known.task.retract_mm) != (config.frame, config.task.retract_mm):
        return (_OPERATORS_FILE,)  # there is no option for these
    options = [
        ("--robot", known.robot.url, config.robot.url),
        ("--sensor", known.sensor.url, config.sensor.url),
        ("--tool-mass-kg", known.tool.mass_kg, config.tool.mass_kg),
    ]
    given = [
        (option, str(value)) for option, before, value in options if value != before and value is not None
    ]
    return (*(() if file is None else (str(file),)), *(text for pair in given for text in pair))


@contextmanager
def record_path(outputs: Outputs) -> Iterator[Path]:
    """Return the path of the recording. A recording that is not kept is in a temporary folder, because the figures
    are computed from it.
    """
    if outputs.record is not None:
        yield outputs.record
        return
    with tempfile.TemporaryDirectory(prefix="hil-bridge-") as folder:
        yield Path(folder) / RECORD


def write_outputs(
    outputs: Outputs, recorded: Callable[[], Recording], end: "RunEnd"
) -> tuple[list[str], list[BridgeError]]:
    """Write the requested outputs other than the recording. Return the lines to print and the failures. `recorded`
    returns the recording, or raises BridgeError.
    """
    lines: list[str] = []
    troubles: list[BridgeError] = []
    try:
        recording = recorded()
        if outputs.record is not None:
            recording = with_file(recording, outputs.record)
        if outputs.temporary:
            recording = replace(recording, file="")
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
    """Return the figures to print first, one per line."""
    tracked, figures = summary.phases_s.get("track", 0.0), summary.figures
    steps = step_lines(summary.steps)
    if not figures:
        return steps
    rows = [("tracked", f"{tracked:.1f} s at {target_force_text(summary)} with {summary.controller}")]
    if summary.force_mean_steady_n is not None:
        rows.append(
            (
                "steady force",
                f"{summary.force_mean_steady_n:.2f} N mean, {figures['steady_peak_to_peak_n']:.2f} N peak to peak",
            )
        )
    elif (peak_to_peak := figures["steady_peak_to_peak_n"]) is not None:
        mean = figures["steady_mean_error_n"]
        rows.append(("steady error", f"{mean:+.2f} N mean, {peak_to_peak:.2f} N peak to peak"))
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
    """Raise ConfigError if an output would overwrite another output, or the file from which the run was started."""
    in_use = {} if config_file is None else {config_file.resolve(): _kind(config_file)}
    requested = [("--record", outputs.record), ("--summary", outputs.summary)]
    requested += [("--report", file) for file in _report_files(outputs)]
    for option, file in requested:
        if file is None:
            continue
        place = file.resolve()
        if place in in_use:
            raise ConfigError(f"{option} {file} would overwrite {in_use[place]}; name another file")
        in_use[place] = option


def _name(source: Path | None) -> str:
    """Return the name for the folder of a run: the name of the configuration, or of the folder with the recording
    that is resumed.
    """
    if source is None:
        return UNNAMED
    return _STAMP.sub("", source.resolve().parent.name) if source.name == RECORD else source.stem


def _kind(source: Path) -> str:
    return "the recording that is resumed" if source.suffix == ".mcap" else "the configuration"


def _own_folder(name: str) -> Path:
    """Create a folder for a run that starts now. If the name exists, a counter is appended. Raises ConfigError."""
    _make(RUNS)
    _check_space(RUNS)
    base_name = f"{wall_time():%Y-%m-%d-%H%M-%S}-{name[:_NAME_LENGTH]}"
    number = 1
    while True:
        folder = RUNS / (base_name if number == 1 else f"{base_name}-{number}")
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
    """Raise ConfigError if the disk that contains a folder is nearly full."""
    try:
        free = shutil.disk_usage(folder).free
    except OSError as error:
        raise ConfigError(f"cannot write into {folder}: {error.strerror}; name another place") from error
    if free < FREE_BYTES_MIN:
        raise ConfigError(
            f"cannot record into {folder}: {free / 1e6:.0f} MB are free, but at least "
            f"{FREE_BYTES_MIN / 1e6:.0f} MB are needed; free some space, or name another folder with --record"
        )
