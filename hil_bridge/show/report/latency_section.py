"""Latency section of the page: breakdown of a cycle's time."""

from html import escape

from hil_bridge.record.analysis.definition import concise
from hil_bridge.record.analysis.latency import Latency, Part, latency_of
from hil_bridge.record.analysis.times import Times
from hil_bridge.record.reader import Recording
from hil_bridge.show.report.latency_bar import latency_bar
from hil_bridge.show.report.markup import across, cells

_TITLES = ("hop", "owner", "p50, ms", "p90, ms", "p99, ms", "max, ms", "description")


def latency_section(recording: Recording) -> str:
    """Render the section; empty if the cycles have no time stamps."""
    latency = latency_of(recording)
    if latency is None:
        return ""
    parts = [
        "<h2>Latency</h2>",
        f'<p class="verdict">{escape(_sentence(latency))}</p>',
        across(latency_bar(latency)),
        cells(_TITLES, [*map(_row, latency.chain), _total(latency)], "narrow"),
    ]
    if latency.beside:
        parts += [
            "<p>Hops of the cycle that the sample does not wait for:</p>",
            cells(_TITLES, map(_row, latency.beside), "narrow"),
        ]
    if latency.constants:
        parts += [
            "<p>Delays without time stamps, to be added:</p>",
            cells(
                ("delay", "ms", "source"),
                [(c.words, concise(c.seconds, 1e3, ".1f", ""), c.source) for c in latency.constants],
                "narrow",
            ),
        ]
    return "\n".join(parts) + "\n"


def _sentence(latency: Latency) -> str:
    p50, p99 = (f"{seconds * 1e3:.0f} ms" for seconds in (latency.total.p50_s, latency.total.p99_s))
    return (
        f"Half of the cycles took {p50} or less from {latency.name}, 99 % at most {p99}."
        f" The largest part: {latency.largest_text}."
    )


def _row(part: Part) -> tuple[str, ...]:
    hop = part.hop
    return (hop.name.replace("_", " "), hop.owner.value, *_figures(part.times), hop.words)


def _total(latency: Latency) -> tuple[str, ...]:
    return ("in all", "", *_figures(latency.total), latency.name)


def _figures(times: Times) -> tuple[str, ...]:
    return tuple(concise(one, 1e3, ".2f", "") for one in (times.p50_s, times.p90_s, times.p99_s, times.max_s))
