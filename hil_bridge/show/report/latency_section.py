"""Latency section of the page: how a cycle's time is spent."""

from html import escape

from hil_bridge.record.analysis.latency import Latency, Part, latency_of
from hil_bridge.record.analysis.times import Times
from hil_bridge.record.reader import Recording
from hil_bridge.show.report.latency_bar import latency_bar
from hil_bridge.show.report.markup import across, cells

_TITLES = ("hop", "whose time", "p50, ms", "p90, ms", "p99, ms", "max, ms", "what it is")


def latency_section(recording: Recording) -> str:
    """Render the section; empty if the cycles were not timestamped."""
    found = latency_of(recording)
    if found is None:
        return ""
    parts = [
        "<h2>Latency</h2>",
        f'<p class="verdict">{escape(_sentence(found))}</p>',
        across(latency_bar(found)),
        cells(_TITLES, [*map(_row, found.chain), _total(found)], "narrow"),
    ]
    if found.beside:
        parts += [
            "<p>Hops of the cycle that the sample does not wait for:</p>",
            cells(_TITLES, map(_row, found.beside), "narrow"),
        ]
    if found.constants:
        parts += [
            "<p>Delays that nothing stamps, to be added:</p>",
            cells(
                ("delay", "ms", "source"),
                [(c.words, f"{c.seconds * 1e3:.1f}", c.source) for c in found.constants],
                "narrow",
            ),
        ]
    return "\n".join(parts) + "\n"


def _sentence(found: Latency) -> str:
    p50, p99 = (f"{seconds * 1e3:.0f} ms" for seconds in (found.total.p50_s, found.total.p99_s))
    return (
        f"Half of the cycles took {p50} or less from {found.name}, 99 % at most {p99}."
        f" The largest part: {found.largest_words}."
    )


def _row(part: Part) -> tuple[str, ...]:
    hop = part.hop
    return (hop.name.replace("_", " "), hop.owner.value, *_figures(part.times), hop.words)


def _total(found: Latency) -> tuple[str, ...]:
    return ("in all", "", *_figures(found.total), found.name)


def _figures(times: Times) -> tuple[str, ...]:
    return tuple(f"{seconds * 1e3:.2f}" for seconds in (times.p50_s, times.p90_s, times.p99_s, times.max_s))
