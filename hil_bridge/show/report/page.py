"""Report of a run: one self-contained page, and on request its picture as PNG and PDF."""

from collections.abc import Iterable, Iterator, Sequence
from html import escape
from pathlib import Path

from msgspec.structs import replace

from hil_bridge.control.analysis.merit import STEADY_SAMPLES
from hil_bridge.devices.facts import RobotFacts
from hil_bridge.errors import Cause, ConfigError
from hil_bridge.record.analysis.definition import UNKNOWN
from hil_bridge.record.analysis.figures import FIGURES
from hil_bridge.record.analysis.strokes import TRACK
from hil_bridge.record.analysis.summary import Summary, end_of
from hil_bridge.record.analysis.why import why_values
from hil_bridge.record.device_facts import devices_of, is_beyond_run
from hil_bridge.record.ending import Outcome
from hil_bridge.record.files import check_place, write_atomically
from hil_bridge.record.next_commands import RunPlaces
from hil_bridge.record.reader import Recording
from hil_bridge.show.charts.cell import cell_picture
from hil_bridge.show.charts.end_panel import end_panel, unbreakable
from hil_bridge.show.charts.facts import start_time
from hil_bridge.show.charts.maps import maps_of
from hil_bridge.show.charts.run import run_charts
from hil_bridge.show.pages import cell_room, document, room
from hil_bridge.show.pages.maps import map_row
from hil_bridge.show.report.bag_page import bag_page
from hil_bridge.show.report.differences import from_defaults
from hil_bridge.show.report.figures import NAMED, Row, merit_rows, response_rows, run_rows
from hil_bridge.show.report.identity import REAL, identity_rows, reality, run_title
from hil_bridge.show.report.latency_section import latency_section
from hil_bridge.show.report.markup import badge, cells, command, fold, pairs, prose, rows
from hil_bridge.show.report.sections import controller_section, stability_section
from hil_bridge.show.report.steps_section import criteria_paragraph, steps_section
from hil_bridge.show.report.surface_section import surface_section

PAGE = "report.html"
PICTURES = {"png": "report.png", "pdf": "report.pdf"}
"""File names of the picture, by the kind of file."""
EVENTS_MAX = 500
_FIRST_PX = 190
"""Height of the first chart on the page of the cell, px. Chosen: an overshoot of 10 % is visible."""


def write_report(
    recording: Recording,
    summary: Summary,
    directory: Path,
    overwrite: bool = False,
    pictures: Sequence[str] = (),
) -> Path:
    """Write the page, and the picture in the requested formats (`png`, `pdf`), into a directory; return the path of
    the page.

    The directory is created if necessary. Raises ConfigError if the directory is not writable or, without
    `overwrite`, already contains such files, and for a picture if matplotlib is not installed.
    """
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"cannot make the directory {directory}: {error.strerror or error}") from error
    for name in (PAGE, *(PICTURES[kind] for kind in pictures)):
        check_place(directory / name, overwrite)
    for kind in pictures:
        from hil_bridge.show.report.plots import draw

        write_atomically(directory / PICTURES[kind], draw(recording, summary, kind), overwrite)
    write_atomically(directory / PAGE, page(recording, summary).encode(), overwrite)
    return directory / PAGE


def page(recording: Recording, summary: Summary) -> str:
    """Render the page as HTML."""
    if recording.foreign is not None:
        return bag_page(recording, recording.foreign, summary)
    charts = run_charts(recording)
    checks = "".join(f"<li>{escape(text)}</li>" for text in summary.checks)
    before = f"<h2>Before contact</h2><ul>{checks}</ul>" if checks else ""
    body = f"""{_point(recording, summary)}
{room("run", charts, first=1)}
<div class="columns head"><section><h2>Figures of merit</h2>{rows(_known(merit_rows(summary)))}</section>
<section><h2>Setup</h2>{pairs(identity_rows(recording, summary), "facts")}</section></div>
{steps_section(recording, summary)}
{map_row(maps_of(recording))}
<div class="columns head"><section><h2>Run</h2>{rows(_known(run_rows(summary)[len(NAMED) :]))}</section>
<section>{before}</section></div>
{fold(_response(summary))}{fold(surface_section(recording))}
{fold(latency_section(recording))}{fold(stability_section(recording, summary))}{fold(controller_section(recording))}
{fold(f"<h2>Events</h2>{_events(recording)}")}
{fold(f"<h2>Settings that are not the defaults</h2>{_settings(recording)}")}
{fold(_counters(summary, devices_of(recording).robot))}"""
    return document(f"{run_title(recording)}, {summary.outcome}", body, cell=bool(recording.cycles))


def _known(figures: Iterable[Row]) -> Iterator[Row]:
    """Yield the figures that have a value."""
    return (row for row in figures if row.value not in ("", UNKNOWN))


def cell_page(recording: Recording, summary: Summary) -> str:
    """Render how the run ended, the cell in three dimensions and the charts, as one HTML file."""
    charts = run_charts(recording)
    first, *others = charts.charts
    charts = replace(charts, charts=[replace(first, height_px=_FIRST_PX), *others])
    return document(
        f"{run_title(recording)}, {summary.outcome}",
        f'<main class="hil-window">{_point(recording, summary)}\n{room("run", charts, first=1)}</main>',
        cell=bool(recording.cycles),
    )


def _point(recording: Recording, summary: Summary) -> str:
    """Render the beginning of a page: how the run ended, and the cell."""
    cell = cell_room(cell_picture(recording), "run") if recording.cycles else ""
    return f"{_head(recording, summary)}\n{cell}"


def _head(recording: Recording, summary: Summary) -> str:
    """Render the heading of the run, and how it ended."""
    which = reality(recording)
    parts = [
        f'<header class="headline"><h1>{escape(run_title(recording))}</h1>',
        f'<span class="badges">{badge(summary.outcome)}',
        f'<span class="badge {"bad" if which == REAL else "plain"}">{escape(which)}</span>' if which else "",
        "</span></header>",
        _reason(recording, summary),
        criteria_paragraph(summary),
        "<p>The recording ends early; this page covers the recorded part.</p>"
        if summary.truncated and end_of(recording).cause is not Cause.CUT
        else "",
    ]
    return "\n".join(filter(None, parts))


def _reason(recording: Recording, summary: Summary) -> str:
    """Render why the run ended, what helps, and the details folded; of a completed run, one sentence."""
    reason, end = why_values(recording), end_of(recording)
    if end.outcome is Outcome.COMPLETED:
        return f'<p class="point">{prose(_completed(recording, summary) or reason.point)}</p>'
    at = start_time(recording) + reason.after_s
    events = [event for event in recording.events if event.at <= at]
    when = f"{end.outcome} after {reason.after_s:.1f} s{f' in {reason.phase}' if reason.phase else ''}"
    lift = end.retracted is False and is_beyond_run(recording)
    panel = end_panel(end, events, when, lift)
    commands = RunPlaces(recording.file, reports=True).next_commands(
        end.outcome, bool(recording.cycles), end.retracted
    )
    lines = "\n".join(f'<p class="{one.style}">{prose(one.text)}</p>' for one in panel.lines)
    buttons = "".join(command(*one) for one in commands)
    detail = f"<details><summary>How it ended, in detail</summary><p>{prose(reason.text)}</p></details>"
    return f"""<section class="bar end {panel.style}">
<div class="why">{lines}</div><div class="next">{buttons}</div>
</section>
{detail}"""


def _completed(recording: Recording, summary: Summary) -> str:
    """Return in one sentence how well a completed run held the force; empty if it did not track one."""
    end = end_of(recording)
    figures = {row.label: row.value for row in (*merit_rows(summary), *response_rows(summary))}
    error, spread, overshoot, most = (
        figures.get(FIGURES[key].words, UNKNOWN)
        for key in ("steady_mean_error_n", "steady_peak_to_peak_n", "overshoot_percent", "track_error_max_n")
    )
    if most != UNKNOWN and summary.strokes == 1:  # the figure ends with the first stroke
        held = f"within {most} from 3 s after the touch"
    elif error != UNKNOWN:
        held = f"with a mean error of {error}, {spread} peak to peak"
        held += f" in the last {STEADY_SAMPLES} samples" * (summary.strokes == 1)
    else:
        return ""
    seconds = sum(summary.phases_s.values())
    targets = {cycle.force_reference for cycle in recording.cycles if cycle.phase == TRACK}
    force = f"{next(iter(targets)):g} N" if len(targets) == 1 else "the target force"
    also = f", overshoot {overshoot}" if overshoot != UNKNOWN else ""
    why = f", ended by its task ({end.text})" if end.text else ""
    text = f"Completed in {seconds:.1f} s{why}: held {force} {held}{also}"
    return unbreakable(f"{text}{end.left and f'; {end.left}'}.")


def _response(summary: Summary) -> str:
    listed = response_rows(summary)
    return f"<h2>Response to touch, target and surface</h2>{rows(listed)}" if listed else ""


def _events(recording: Recording) -> str:
    zero = start_time(recording)
    lines = ((f"{event.at - zero:.3f}", event.kind, event.text) for event in recording.events[:EVENTS_MAX])
    event_table = cells(("time, s", "event", ""), lines, "narrow events")
    more = len(recording.events) - EVENTS_MAX
    return f'<div class="scroll">{event_table}</div>' + (
        f"<p>and {more} more in the recording</p>" if more > 0 else ""
    )


def _settings(recording: Recording) -> str:
    return cells(("setting", "value", "default"), from_defaults(recording), "narrow settings")


def _counters(summary: Summary, robot: RobotFacts) -> str:
    """Render the link counters: nonzero counters with their values, all others by name only."""
    nonzero = [(robot.counter_label(name), f"{value:g}") for name, value in summary.link.items() if value]
    zero = [robot.counter_label(name) for name, value in summary.link.items() if not value]
    if not summary.link:
        return ""
    return "".join(_counted(nonzero, zero))


def _counted(nonzero: Sequence[tuple[str, str]], zero: Sequence[str]) -> Iterator[str]:
    yield f"<h2>Link counters</h2>{pairs(nonzero)}"
    if zero:
        yield f'<p class="quiet">0: {escape(", ".join(zero))}</p>'
