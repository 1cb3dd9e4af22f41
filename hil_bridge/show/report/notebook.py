"""Notebook display of a run and its figures, as HTML without scripts and style sheets."""

from collections.abc import Iterable
from html import escape

from hil_bridge.errors import ConfigError
from hil_bridge.record.analysis.summary import Summary, summarise
from hil_bridge.record.reader import NO_CYCLE, Recording
from hil_bridge.show.picture_files import save_figure
from hil_bridge.show.report.figures import Row, contact_rows, merit_rows

_CHART = "force"
"""Id of the chart to the right of the figures."""


def run_html(recording: Recording) -> str:
    """Render how a run ended, its figures of merit and its force over time.

    The chart is omitted if matplotlib is not installed.
    """
    if not recording.cycles:
        return f"<p>{escape(NO_CYCLE)}</p>"
    summary = summarise(recording)
    if recording.foreign is not None:
        title = f"<p><b>{escape(recording.foreign.file)}</b></p>"
        return f"{title}{_picture(recording)}{_figures_html(contact_rows(summary))}"
    heading = (
        f"<p><b>{escape(summary.controller or 'run')}: {escape(summary.outcome)}</b> {escape(summary.text)}"
    )
    left = f"<br>left: {escape(summary.left)}" if summary.left else ""
    return f"{heading}{left}</p>{_picture(recording)}{figures_html(summary)}"


def figures_html(summary: Summary) -> str:
    """Render the figures of merit with their meaning."""
    return _figures_html(merit_rows(summary))


def _figures_html(rows: Iterable[Row]) -> str:
    return _table((row.label, row.value, row.explanation) for row in rows)


def _picture(recording: Recording) -> str:
    from hil_bridge.show.report.plots import plot

    try:
        drawn = save_figure(plot(recording, [_CHART]), "svg").decode()
    except ConfigError:
        return ""
    return drawn[drawn.index("<svg") :].replace("<svg", '<svg style="max-width: 100%; height: auto"', 1)


def _table(rows: Iterable[tuple[str, ...]]) -> str:
    body = "".join(f"<tr>{''.join(f'<td>{escape(text)}</td>' for text in row)}</tr>" for row in rows)
    return f"<table><tbody>{body}</tbody></table>"
