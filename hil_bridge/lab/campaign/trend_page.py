"""Comparison of campaigns as text and as a page."""

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from itertools import zip_longest
from typing import NamedTuple

from hil_bridge.lab.campaign.comparison import setting_lines
from hil_bridge.lab.campaign.digest import Tally
from hil_bridge.lab.campaign.trends import CellChange, Change, FigureChange, Trend
from hil_bridge.lab.text_tables import aligned
from hil_bridge.record.analysis.definition import UNKNOWN, concise, difference, rounded
from hil_bridge.record.analysis.figures import FIGURES
from hil_bridge.show.charts.end_panel import unbreakable
from hil_bridge.show.pages import Axis, Chart, Charts, Series, document, room
from hil_bridge.show.pages.svg import Interval, interval_plot
from hil_bridge.show.report.markup import Value, cells, fold, prose, stacked

SERIES_MOST = 8
"""Maximum number of cells in a chart. Chosen: the number of distinguishable colours."""
CHARTS_MOST = 12
"""Maximum number of charts of figures, most significant first. Chosen: the table has the other figures."""
FIGURES_MOST = 30
"""Maximum number of figures in the text, most significant first. Chosen: one screen."""
FIRST_FIGURES = 8
"""Number of figures on the page that are not folded, at least. Chosen: what a screen has below the first table."""
_FIRST_CHARTS = 3
"""Number of charts that are not folded. Chosen: one row of the page."""
_SETTINGS_MOST = 2
"""Maximum number of settings named in the first sentences, instead of in a table. Chosen."""
_TESTS = "adjusted p", "change"
"""Titles of the columns with the test of a row."""
_PLOTS = "In plots, closer to the vertical line, if there is one, is better, and an arrow is never, or none."
_PLACE = "place"
_CASE = "case "
_CLASSES = {Change.WORSE: "bad", Change.BETTER: "good", Change.OTHER: "", Change.NONE: ""}


class _Row(NamedTuple):
    """Row of a table of the comparison."""

    labels: tuple[str, ...]
    values: tuple[str, ...]
    """Value in each of the results."""
    intervals: tuple[str, ...]
    """Interval of each value; empty if there is none."""
    best: frozenset[int]
    """Places of the results with the best value."""
    plot: str
    """Plot of the values as HTML."""
    more: tuple[str, ...]
    """Texts of the columns behind the values."""
    change: Change


def headline(trend: Trend) -> str:
    """Return the outcome of the comparison as one line."""
    first, last = trend.results[0].name, trend.results[-1].name
    count = len(trend.primary) + len(_differing(trend))
    return f"{first} → {last}: {_outcome(trend)} in {len(trend.cells)} cells and {count} figures"


def _outcome(trend: Trend) -> str:
    worse, better = trend.significant
    if worse and better and trend.overall.change:
        return f"{worse} significantly worse, {better} better, passed runs {trend.overall.change}"
    if worse or better:
        return f"{worse} significantly worse, {better} better"
    if trend.overall.change:
        return f"significantly {trend.overall.change} over all cells"
    return "no significant difference" if trend.tested else "too few runs for a significant difference"


def trend_lines(trend: Trend) -> Iterator[str]:
    """Yield the comparison as text, line by line."""
    for one in trend.results:
        yield f"{one.name}: {one.campaign}, {one.tally.text}; {one.facts.get('Code', '')}"
    yield from setting_lines(trend.settings)
    yield headline(trend)
    yield _verdict(trend).replace("`", "")
    listed = trend.primary or _ranked(trend)[:FIGURES_MOST]
    if listed:
        yield ""
        rows = [_line_of(_figure_row(trend, row, trend.tested)) for row in listed]
        yield from aligned(_columns(trend, True, trend.tested), rows)
    if more := len(trend.primary) + len(_differing(trend)) - len(listed):
        yield f"and {more} more figures, on the page"
    differing, same = _cells(trend)
    yield ""
    yield from aligned(
        _columns(trend, False, trend.tested), [_line_of(_cell_row(trend, row)) for row in differing]
    )
    if same:
        yield f"and {len(same)} more cells, the same in all results"
    yield f"*: {_best_words(trend)} {_note(trend)}"


def trend_page(trend: Trend) -> str:
    """Render the comparison as a self-contained page."""
    names = [one.name for one in trend.results]
    better = Change.BETTER in trend.changes
    style = "warn" if trend.worse and better else "bad" if trend.worse else "good" if better else "plain"
    facts = list(dict.fromkeys(name for one in trend.results for name in one.facts))
    sides = [
        ("passed, failed, errors", *(one.tally.text for one in trend.results)),
        ("campaign", *(one.campaign for one in trend.results)),
        *((name, *(one.facts.get(name, UNKNOWN) for one in trend.results)) for name in facts),
    ]
    kind = "single runs" if _single(trend) else "medians"
    others = f"{'Other figures' if trend.primary else 'Figures'} that differ, {kind}"
    compared = escape(" and ".join(names)) if len(names) == 2 else f"{len(names)} campaigns"
    course = settings = ""
    if len(names) > 2:  # a line between two points says nothing
        charts = room("trend", trend_charts(trend), first=_FIRST_CHARTS)
        course = f"<h2>Course over the results</h2>{charts}"
    if len(trend.settings) > _SETTINGS_MOST:  # otherwise the first sentences name them
        rows = [(one.key, one.before, one.after) for one in trend.settings]
        table = cells(("setting", names[0], names[-1]), rows, "narrow settings")
        settings = f"<h2>Settings that differ</h2>{table}"
    sections = [("Runs that passed, by cell", _cell_tables(trend))]
    differing = others if trend.tested else "Largest differences, not tested"
    sections.insert(any(row.best for row in trend.cells), (differing, _other_figures(trend)))
    if trend.primary:
        sections.insert(0, (f"Primary figures, {kind}", _figure_table(trend, trend.primary, trend.tested)))
    best = f"<strong>Bold</strong>: {_best_words(trend)} " if trend.tested else ""
    note = f'<p class="quiet small">{best}{escape(unbreakable(_note(trend)))} {_PLOTS}</p>'
    tables = (f"<h2>{title}</h2>{note * (n == 0)}{table}" for n, (title, table) in enumerate(sections))
    body = f"""<header class="headline"><h1>{compared} compared</h1>
<span class="badge {style}">{_outcome(trend)}</span></header>
<p class="point">{prose(unbreakable(point(trend)))}</p>
{"".join(tables)}
{settings}
{course}
{fold(f"<h2>The results</h2>{cells(('', *names), sides, 'sides')}")}"""
    return document(f"compared: {', '.join(names)}", body)


def point(trend: Trend) -> str:
    """Return in three or four sentences which results are better by what, how many runs passed, and what differs."""
    first, last = trend.results[0], trend.results[-1]
    settings = trend.settings
    differ = [
        f"`{one.key}` is {one.before} in `{first.name}` and {one.after} in `{last.name}`" for one in settings
    ]
    if len(settings) > _SETTINGS_MOST:
        differ = [f"{len(settings)} settings differ"]
    unfinished = [
        f"`{one.name}` has {one.tally.total} of {one.planned} runs"
        for one in trend.results
        if one.tally.total < one.planned
    ]
    note = f" ({'; '.join(unfinished)})" * bool(unfinished)
    passed = f"Passed runs: {_count(first.tally)} → {_count(last.tally)}{note}."
    return f"{_verdict(trend)} {passed} {'; '.join(differ) or 'No setting differs'}."


def _verdict(trend: Trend) -> str:
    """Return in one or two sentences how many figures are better and worse, and in which the results differ most."""
    last = f"`{trend.results[-1].name}`"
    levels: tuple[tuple[str, Sequence[CellChange | FigureChange]], ...] = (
        ("primary figures", trend.primary),
        ("cells and figures", (*trend.cells, *trend.figures)),
    )
    for kind, rows in levels:
        if judged := [row for row in rows if row.change in (Change.BETTER, Change.WORSE)]:
            counts = _counts(Counter(row.change for row in judged), len(rows))
            sides = ([row for row in judged if row.change is one] for one in (Change.BETTER, Change.WORSE))
            clearest = [_describe(trend, min(rows, key=_significance)) for rows in sides if rows]
            verb = "is" if len(clearest) == 1 else "are"
            return f"{last} is significantly {counts} {kind}; the clearest {verb} {' and '.join(clearest)}."
    if trend.overall.change:
        return f"{last} is significantly {trend.overall.change} over all cells."
    if not (listed := trend.primary or _differing(trend)):
        return "No figure differs."
    kind = "primary figures" if trend.primary else "figures that differ"
    directions = Counter(row.direction for row in listed)
    better = f"{last} is {_counts(directions, len(listed))} {kind}"
    if rest := directions[Change.NONE] + directions[Change.OTHER]:
        equal = " or equal values" * bool(trend.primary)
        better += f" ({rest} {'has' if rest == 1 else 'have'} no preferred direction{equal})"
    better += f"; the largest difference is {_describe(trend, max(listed, key=_difference))}."
    if trend.tested:
        return f"{better} No difference is significant."
    return f"{better} Nothing is tested: a difference can be significant from {trend.runs_needed} seeds on."


def _counts(changes: Mapping[Change, int], count: int) -> str:
    return f"better in {changes[Change.BETTER]} and worse in {changes[Change.WORSE]} of {count}"


def _describe(trend: Trend, row: CellChange | FigureChange) -> str:
    """Describe a change by the values before and after it, and its direction if it is significant."""
    if isinstance(row, FigureChange):
        what = row.title or f"{row.label} at {_label(trend, row.cell)}"
        before, after = (_median_text(row, place) for place in (0, -1))
    else:
        what = f"runs that passed, {_label(trend, row.cell)}"
        before, after = _count(row.tallies[0]), _count(row.tallies[-1])
    return f"{what}: {before} → {after}" + f" ({row.change})" * bool(row.change)


def _note(trend: Trend) -> str:
    """Explain the values and the tests of the tables in a few sentences."""
    first, last = trend.results[0].name, trend.results[-1].name
    parts = [f"The difference is {last} minus {first}."]
    if not _single(trend):
        parts.append("Brackets hold the interval of 95 % of a median, or the range of up to five runs.")
    if not trend.tested:
        parts.append(f"Nothing is tested with so few runs; a test needs {trend.runs_needed} seeds.")
    else:
        parts.append(
            f"Tests compare {first} with {last}: runs that passed by Fisher's exact test, figures by the Mann-Whitney "
            "test. A change is significant if p, adjusted after Holm for the number of tests, is below "
            f"{trend.level:g}."
        )
    return " ".join(parts)


def _best_words(trend: Trend) -> str:
    """Explain the mark of the best values."""
    best = "better" if len(trend.results) == 2 else "best"
    return f"{best}{', where the change is significant' * trend.tested}."


def _single(trend: Trend) -> bool:
    """Return whether every figure is that of a single run."""
    return all(count <= 1 for row in (*trend.primary, *trend.figures) for count in row.runs)


def _cells(trend: Trend) -> tuple[Sequence[CellChange], Sequence[CellChange]]:
    """Return the row over all cells with the cells that differ, and the cells that are the same in all results. A
    single cell has no row over all cells.
    """
    if len(trend.cells) == 1:
        return trend.cells, ()
    differing = [row for row in trend.cells if row.best]
    return [trend.overall, *differing], [row for row in trend.cells if not row.best]


def _cell_tables(trend: Trend) -> str:
    """Render the counts of runs by cell; the cells that are the same in all results are folded."""
    differing, same = (
        _render(trend, _columns(trend, False, trend.tested), [_cell_row(trend, row) for row in rows])
        if rows
        else ""
        for rows in _cells(trend)
    )
    count = len(_cells(trend)[1])
    return differing + fold(f"<h2>{count} more cells, the same in all results</h2>{same}" * bool(same))


def _columns(trend: Trend, figures: bool, tests: bool) -> tuple[str, ...]:
    """Return the titles of the columns of a table of cells, or of figures."""
    names = (one.name for one in trend.results)
    return *("figure",) * figures, "cell", *names, *("difference",) * figures, *_TESTS * tests


def _cell_row(trend: Trend, row: CellChange) -> _Row:
    counts = tuple(map(_count, row.tallies))
    first, last = ((one, one, one) if (one := _share(row.tallies[k])) is not None else None for k in (0, -1))
    return _Row(
        (_label(trend, row.cell),),
        counts,
        ("",) * len(counts),
        _best(trend, row),
        interval_plot(first, last, 100.0, _CLASSES[row.change]) if row.best else "",
        _test_texts(row) * trend.tested,
        row.change,
    )


def _count(tally: Tally) -> str:
    return f"{tally.passed}/{tally.total}" if tally.total else UNKNOWN


def _figure_row(trend: Trend, row: FigureChange, tests: bool) -> _Row:
    medians = tuple(_median_text(row, place) for place in range(len(row.medians)))
    intervals = tuple(_interval_text(row, place, trend.tested) for place in range(len(row.medians)))
    more = (_difference_text(row), *_test_texts(row) * tests)
    ideal = FIGURES[row.figure].ideal(min((one for one in row.medians if one is not None), default=0.0))
    plot = interval_plot(_ends(row, 0), _ends(row, -1), ideal, _CLASSES[row.change])
    labels = row.label, _label(trend, row.cell)
    return _Row(labels, medians, intervals, _best(trend, row), plot, more, row.change)


def _ends(row: FigureChange, place: int) -> Interval | None:
    """Return a median between the ends of its interval; None without a run."""
    median, interval = row.medians[place], row.intervals[place]
    value = math.inf if median is None else median
    return None if interval is None else (interval[0], value, interval[1])


def _label(trend: Trend, cell: str) -> str:
    """Return the label of a cell without the name of the axis `case`, if every cell begins with it."""
    return cell.removeprefix(_CASE) if all(one.cell.startswith(_CASE) for one in trend.cells) else cell


def _best(trend: Trend, row: CellChange | FigureChange) -> frozenset[int]:
    """Return the places of the best value; none if it was tested and is not significantly better."""
    return frozenset() if trend.tested and not row.change else row.best


def _difference_text(row: FigureChange) -> str:
    """Format the last median minus the first, each rounded as the table shows it; a dash if one is infinite."""
    first, last = row.medians[0], row.medians[-1]
    return UNKNOWN if first is None or last is None else difference(first, last, FIGURES[row.figure])


def _median_text(row: FigureChange, place: int) -> str:
    """Format a median of the results at a place."""
    if not row.runs[place]:
        return UNKNOWN
    median = row.medians[place]
    return _number(row, math.inf if median is None else median, FIGURES[row.figure].unit)


def _interval_text(row: FigureChange, place: int, tested: bool) -> str:
    """Format the interval of a median; of results that are too few for tests, also the number of runs."""
    ends = dict.fromkeys(_number(row, value) for value in row.intervals[place] or ())
    parts = [" … ".join(ends)] * (len(ends) > 1)
    parts += [f"{row.runs[place]} run{'s' * (row.runs[place] != 1)}"] * (not tested)
    return f"({'; '.join(parts)})" if parts else ""


def _number(row: FigureChange, value: float, unit: str = "") -> str:
    definition = FIGURES[row.figure]
    if not math.isfinite(value):
        return definition.infinite
    if not rounded(value, definition):
        return f"0 {unit}".rstrip()
    return concise(value, definition.scale, definition.form, unit)


def _test_texts(row: CellChange | FigureChange) -> tuple[str, ...]:
    """Return the texts of the columns _TESTS."""
    return _probability(row.adjusted), row.change.value


def _probability(value: float | None) -> str:
    if value is None:
        return UNKNOWN
    return f"{value:.3f}" if value >= 0.001 else "< 0.001"


def _significance(row: CellChange | FigureChange) -> tuple[float, float, float]:
    """Return a key that sorts rows by significance, and equally significant figures by their relative change."""
    return (
        2.0 if row.adjusted is None else row.adjusted,
        2.0 if row.probability is None else row.probability,
        -_relative_change(row) if isinstance(row, FigureChange) else 0.0,
    )


def _relative_change(row: FigureChange) -> float:
    """Return the change of the displayed median as a share of both medians and the smallest relevant difference, from
    0 to 1. It is 0 if a median is 0 and no smallest relevant difference gives it a scale.
    """
    definition, (first, *_, last) = FIGURES[row.figure], _displayed(row)
    if first is None or last is None:
        return float(first is not last)
    least = (definition.least or 0.0) * definition.scale
    if not least and not (first and last):
        return 0.0
    return abs(last - first) / (abs(first) + abs(last) + least)


def _difference(row: FigureChange) -> tuple[bool, float]:
    """Return a key that is the larger, the more a figure differs; figures without a preferred direction are least."""
    return row.direction is not Change.OTHER, _relative_change(row)


def _displayed(row: FigureChange) -> list[float | None]:
    """Return the medians as displayed; None for an infinite or unknown one."""
    return [None if one is None else rounded(one, FIGURES[row.figure]) for one in row.medians]


def _differing(trend: Trend) -> list[FigureChange]:
    """Return the figures that are not primary and whose displayed medians differ, or that changed significantly."""
    return [
        row
        for row in trend.figures
        if row.change or len({*zip(_displayed(row), map(bool, row.runs), strict=True)}) > 1
    ]


def _ranked(trend: Trend) -> list[FigureChange]:
    """Return the figures that are not primary: the most significant first, then of each figure the cell in which it
    changed most, and then the others, beginning with the figures that have a preferred direction.
    """
    significant = sorted((row for row in trend.figures if row.change), key=_significance)
    others = [row for row in _differing(trend) if not row.change]
    by_figure: dict[str, list[FigureChange]] = {}
    for row in sorted(others, key=_difference, reverse=True):
        by_figure.setdefault(row.figure, []).append(row)
    turns = zip_longest(*by_figure.values())
    return [*significant, *(row for rows in turns for row in rows if row is not None)]


def _other_figures(trend: Trend) -> str:
    """Render the figures that are not primary; most of those that are not significant are folded."""
    rows = _ranked(trend)
    if not rows:
        return "<p>Every figure is the same in all results.</p>"
    first = max(FIRST_FIGURES, sum(row.change is not Change.NONE for row in rows))
    table = _figure_table(trend, rows[:first], any(row.change for row in rows))
    more = f"<h2>{len(rows) - first} more figures</h2>{_figure_table(trend, rows[first:], trend.tested)}"
    return table + (fold(more) if len(rows) > first else "")


def _figure_table(trend: Trend, rows: Sequence[FigureChange], tests: bool) -> str:
    return _render(trend, _columns(trend, True, tests), [_figure_row(trend, row, tests) for row in rows])


def _render(trend: Trend, titles: Sequence[str], rows: Sequence[_Row]) -> str:
    """Render a table with a plot of each row; if there are tests, the best values are bold, and the significant changes
    coloured.
    """
    names, labels = [one.name for one in trend.results], titles.index("cell") + 1
    names[0], names[-1] = f"○ {names[0]}", f"● {names[-1]}"
    lines: list[Sequence[str | Value]] = [
        (
            Value(row.labels[0], "", *row.labels[1:]),
            *(
                Value(text, "best" if trend.tested and place in row.best else "", interval)
                for place, (text, interval) in enumerate(zip(row.values, row.intervals, strict=True))
            ),
            Value("", "plotted", "", row.plot),
            *(Value(text, _CLASSES[row.change] if text == row.change else "") for text in row.more),
        )
        for row in rows
    ]
    return stacked((titles[0], *names, "", *titles[labels + len(names) :]), lines, 1)


def _line_of(row: _Row) -> tuple[str, ...]:
    """Return a row as text, with an asterisk at the best value."""
    values = [
        f"{text} {interval}".rstrip() + " *" * (place in row.best)
        for place, (text, interval) in enumerate(zip(row.values, row.intervals, strict=True))
    ]
    return *row.labels, *values, *row.more


def trend_charts(trend: Trend) -> Charts:
    """Return charts of the share of runs that passed, and of the medians of figures, over the results in their
    order.

    A cell has one colour in all charts. If there are more cells than colours, the cells with the most significant
    changes are drawn.
    """
    ranked = sorted(trend.cells, key=lambda row: 2.0 if row.probability is None else row.probability)
    drawn = {row.cell for row in ranked[:SERIES_MOST]}
    cells = [one.cell for one in trend.cells if one.cell in drawn]
    colours = {cell: f"{place + 1}" for place, cell in enumerate(cells)}
    shares: dict[str, Sequence[float | None]] = {
        row.cell: [_share(one) for one in row.tallies] for row in trend.cells
    }
    lines = {"passed": ("Runs that passed", "%", shares)}
    for row in (*trend.primary, *_ranked(trend)):
        title = f"Median: {FIGURES[row.figure].words}"
        lines.setdefault(row.figure, (title, FIGURES[row.figure].unit, {}))[2][row.cell] = row.medians
    sources: dict[str, dict[str, Sequence[float | None]]] = {}
    charts = []
    for name, (title, unit, values) in list(lines.items())[: CHARTS_MOST + 1]:
        chosen = {colours[cell]: values[cell] for cell in cells if cell in values}
        sources[name] = {"x": list(map(float, range(len(trend.results)))), **chosen}
        series = [
            Series(name, colours[cell], cell, colours[cell], width=2.0) for cell in cells if cell in values
        ]
        if series:
            charts.append(Chart(name, title, unit, series, axis=_PLACE, height_px=170, zero=name == "passed"))
    axis = Axis("results", "", names=[one.name for one in trend.results])
    return Charts({_PLACE: axis}, charts, sources)


def _share(tally: Tally) -> float | None:
    return 100.0 * tally.passed / tally.total if tally.total else None
