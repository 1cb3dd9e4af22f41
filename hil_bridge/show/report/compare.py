"""Several runs laid over each other: one page with the charts of all, and tables of what differs."""

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path

import numpy as np

from hil_bridge.errors import ConfigError
from hil_bridge.record import STOP_EVENT
from hil_bridge.record.analysis.strokes import TRACK
from hil_bridge.record.analysis.summary import Summary, cycle_times, phases, summarise
from hil_bridge.record.analysis.why import why
from hil_bridge.record.device_facts import devices_of
from hil_bridge.record.reader import Recording
from hil_bridge.show.pages import Axis, Chart, Charts, Layer, Limit, Mark, Series, document, room
from hil_bridge.show.report.differences import between
from hil_bridge.show.report.figures import merit_rows, run_rows
from hil_bridge.show.report.identity import identity_rows
from hil_bridge.show.report.markup import across, cells
from hil_bridge.show.report.sources import Array, Sources, column, parts, start_time

RUNS_MOST = 8
"""As many colours as are told apart."""
TOUCH, BEGIN = "touch", "begin"
"""What lies at 0 s: the start of the first tracking, or that of the run."""
_TITLES = {
    "force": ("Force along the approach, positive while pressing", "N"),
    "lateral": ("Lateral force at the tool, magnitude", "N"),
    "moment": ("Moment about the tool frame's origin, magnitude", "N·m"),
    "depth": ("Depth along the approach from the start point, reported", "mm"),
    "correction": ("Correction of the depth per cycle", "mm"),
    "stiffness": ("Estimated stiffness of the contact", "N/m"),
    "cycle_ms": ("Time of the cycle", "ms"),
}
_HEIGHT_PX = {"force": 260}


def compare_page(runs: Mapping[str, Recording], align: str = TOUCH) -> str:
    """The page of at least two runs by their names. Raises ConfigError for too few or too many."""
    if not 2 <= len(runs) <= RUNS_MOST:
        raise ConfigError(f"compare takes 2 to {RUNS_MOST} recordings, not {len(runs)}")
    summaries = {name: summarise(recording) for name, recording in runs.items()}
    charts, left_out = _charts(runs, align)
    names = list(runs)
    ends = "".join(
        f"<dt><strong>{escape(name)}</strong>: {escape(summaries[name].outcome)}</dt><dd>{escape(why(runs[name]))}</dd>"
        for name in names
    )
    settings = between(list(runs.values()))
    body = f"""<h1>{len(runs)} runs compared</h1>
<dl>{ends}</dl>
<h2>Course</h2>
{room("runs", charts)}{f'<p class="quiet">{escape(left_out)}</p>' if left_out else ""}
<h2>Figures</h2>
<p class="quiet">What is the same in all runs is quiet.</p>
{across(_figures(runs, summaries))}
<h2>Settings that differ</h2>
{cells(("setting", *names), settings, "narrow settings")}"""
    return document(f"compared: {', '.join(names)}", body)


def names_of(paths: Sequence[Path]) -> list[str]:
    """Short names for recordings, no two the same: file, else folder and file, else the whole path."""
    for name in (lambda path: path.stem, lambda path: f"{path.absolute().parent.name}/{path.stem}", str):
        found = [name(path) for path in paths]
        if len(set(found)) == len(found):
            return found
    raise ConfigError("compare was given the same recording twice")


def _charts(runs: Mapping[str, Recording], align: str) -> tuple[Charts, str]:
    sources = Sources()
    series: dict[str, list[Series]] = {key: [] for key in _TITLES}
    marks: list[Mark] = []
    for place, (name, recording) in enumerate(runs.items()):
        zero = _zero(recording, align)
        layer, colour = f"run{place}", f"{place + 1}"
        time = column(recording.cycles, "controlled_at") - zero
        for key, values in _columns(recording).items():
            if not np.isfinite(values).any():
                continue
            source = sources.add(layer, key, time, {key: values})
            series[key].append(Series(source, key, name, colour, layer=layer))
        marks += [
            Mark(event.at - zero, f"{name}: stop: {event.text}", "stop", layer=layer)
            for event in recording.events
            if event.kind == STOP_EVENT
        ]
    target = _same_target(list(runs.values()))
    charts = [
        Chart(
            key,
            *_TITLES[key],
            series=found,
            limits=[Limit(target, "target", "target")] if key == "force" and target is not None else [],
            log=key == "stiffness",
            height_px=_HEIGHT_PX.get(key, 170),
        )
        for key, found in series.items()
        if found
    ]
    label = "time since the touch" if align == TOUCH else "time since the run began"
    layers = [Layer(f"run{place}", name) for place, name in enumerate(runs)]
    return Charts({"time": Axis(label, "s")}, charts, sources.found, marks, layers=layers), sources.sentence()


def _columns(recording: Recording) -> dict[str, Array]:
    cycles = recording.cycles
    wrench = parts(cycles, "wrench", 6)
    stiffness = column(cycles, "stiffness")
    seconds = cycle_times(cycles, devices_of(recording).robot.cycle_s is not None)
    return {
        "force": column(cycles, "force"),
        "lateral": np.hypot(wrench[:, 0], wrench[:, 1]),
        "moment": np.linalg.norm(wrench[:, 3:], axis=1),
        "depth": 1e3 * column(cycles, "depth"),
        "correction": 1e3 * column(cycles, "correction"),
        "stiffness": np.where(stiffness > 0.0, stiffness, np.nan),
        "cycle_ms": 1e3 * np.array([*seconds, *[np.nan] * (len(cycles) - len(seconds))]),
    }


def _zero(recording: Recording, align: str) -> float:
    """What lies at 0, s on the run's clock; a run that never tracked begins there."""
    touched = [span.begin for span in phases(recording) if span.name == TRACK]
    return touched[0] if touched and align == TOUCH else start_time(recording)


def _same_target(recordings: Sequence[Recording]) -> float | None:
    wanted = {cycle.force_reference for recording in recordings for cycle in recording.cycles}
    return wanted.pop() if len(wanted) == 1 else None


def _figures(runs: Mapping[str, Recording], summaries: Mapping[str, Summary]) -> str:
    """A row for each figure, a column for each run."""
    columns = []
    for name, recording in runs.items():
        summary = summaries[name]
        told = dict(identity_rows(recording, summary))
        told["outcome"] = summary.outcome
        told |= {row.label: row.value for row in (*merit_rows(summary), *run_rows(summary))}
        columns.append(told)
    lines = []
    for label in dict.fromkeys(label for told in columns for label in told):
        values = [told.get(label, "–") or "–" for told in columns]
        quiet = ' class="quiet"' if len(set(values)) == 1 else ""
        lines.append(
            f"<tr{quiet}><td>{escape(label)}</td>{''.join(f'<td>{escape(value)}</td>' for value in values)}</tr>"
        )
    head = "".join(f"<th>{escape(name)}</th>" for name in ("", *runs))
    return f'<table class="narrow"><thead><tr>{head}</tr></thead><tbody>{"".join(lines)}</tbody></table>'
