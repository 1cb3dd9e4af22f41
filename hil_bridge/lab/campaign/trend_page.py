"""Comparison of campaigns as text and as a page."""

from collections.abc import Iterator, Mapping, Sequence
from html import escape

from hil_bridge.lab.campaign.comparison import setting_lines
from hil_bridge.lab.campaign.digest import Tally
from hil_bridge.lab.campaign.trends import CellChange, Change, FigureChange, Trend
from hil_bridge.lab.text_tables import aligned
from hil_bridge.record.analysis.definition import UNKNOWN, concise
from hil_bridge.record.analysis.figures import FIGURES
from hil_bridge.show.pages import Axis, Chart, Charts, Series, document, room
from hil_bridge.show.report.markup import across, cells, fold, prose, table

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
"""Maximum number of settings named in the first sentence. Chosen: the table has all."""
_TEXT_COLUMNS = "figure", "cell", ""
_PLACE = "place"
_CLASSES = {Change.WORSE: "bad", Change.BETTER: "good", Change.OTHER: "", Change.NONE: ""}


def headline(trend: Trend) -> str:
    """Return the outcome of the comparison as one line."""
    first, last = trend.results[0].name, trend.results[-1].name
    count = len(trend.primary) + len(trend.figures)
    return f"{first} → {last}: {_outcome(trend)} in {len(trend.cells)} cells and {count} figures"


def _outcome(trend: Trend) -> str:
    worse, better = trend.significant
    if worse or better:
        return f"{worse} significantly worse, {better} better"
    return "too few runs for a significant difference" if trend.runs_needed else "no significant difference"


def trend_lines(trend: Trend) -> Iterator[str]:
    """Yield the comparison as text, line by line."""
    for one in trend.results:
        yield f"{one.name}: {one.campaign}, {one.tally.text}; {one.facts.get('Code', '')}"
    yield from setting_lines(trend.settings)
    yield headline(trend)
    names = [one.name for one in trend.results]
    columns = ("figure", "cell", *(f"median {name}" for name in names), "p", "adjusted", "")
    listed = trend.primary or sorted(trend.figures, key=_significance)[:FIGURES_MOST]
    if listed:
        yield ""
        yield from aligned(columns, [_figure_row(row) for row in listed])
    if more := len(trend.primary) + len(trend.figures) - len(listed):
        yield f"and {more} more figures, on the page"
    differing, same = _cells(trend)
    yield ""
    yield from aligned(("cell", *names, "p", "adjusted", ""), [_cell_row(row) for row in differing])
    if same:
        yield f"and {len(same)} more cells, the same in all results"


def trend_page(trend: Trend) -> str:
    """Render the comparison as a self-contained page."""
    names = [one.name for one in trend.results]
    worse, better = trend.significant
    style = "bad" if worse else "good" if better else "plain"
    facts = list(dict.fromkeys(name for one in trend.results for name in one.facts))
    sides = [
        ("passed, failed, errors", *(one.tally.text for one in trend.results)),
        ("campaign", *(one.campaign for one in trend.results)),
        *((name, *(one.facts.get(name, UNKNOWN) for one in trend.results)) for name in facts),
    ]
    body = f"""<header class="headline"><h1>{len(names)} campaigns compared</h1>
<span class="badge {style}">{_outcome(trend)}</span></header>
<p class="point">{prose(point(trend))}</p>
{_primary_table(trend, names)}
<h2>Runs that passed, by cell</h2>
{_cell_tables(trend, names)}
<h2>{"Other figures" if trend.primary else "Figures"} that differ, medians by cell</h2>
{_figure_tables(trend, names)}
<p class="quiet">Tests compare {escape(names[0])} with {escape(names[-1])}: runs that passed by Fisher's exact test,
figures by the Mann-Whitney test. A change is significant if its probability, adjusted after Holm for the number of
tests, is below {trend.level:g}. Brackets hold the interval of 95 % of a median, or the range of up to five runs.</p>
{_setting_table(trend, names)}
{_course(trend)}
{fold(f"<h2>The results</h2>{cells(('', *names), sides, 'narrow')}")}"""
    return document(f"compared: {', '.join(names)}", body)


def point(trend: Trend) -> str:
    """Return in one or two sentences what differs, how many runs passed, and which results are better by what."""
    first, last = trend.results[0], trend.results[-1]
    settings = trend.settings
    differ = [
        f"`{one.key}` is {one.before} in `{first.name}` and {one.after} in `{last.name}`" for one in settings
    ]
    if len(settings) > _SETTINGS_MOST:
        differ = [f"{len(settings)} settings differ"]
    passed = [f"{one.tally.passed} of {one.tally.total} runs passed in `{one.name}`" for one in (first, last)]
    sentence = "; ".join([*(differ or ["no setting differs"]), " and ".join(passed)])
    return f"{sentence[:1].upper()}{sentence[1:]}. {_strongest(trend)}"


def _strongest(trend: Trend) -> str:
    """Describe the most significant change of a cell or figure in one sentence; if none is significant, the nearest."""
    changes: list[CellChange | FigureChange] = [*trend.cells, *trend.primary, *trend.figures]
    tested = [row for row in changes if row.adjusted is not None]
    if not tested:
        return "No difference can be tested."
    row = min(tested, key=_significance)
    if row.change is Change.NONE and trend.runs_needed:
        return (
            f"No figure can differ significantly with so few runs; from {trend.runs_needed} seeds on, it can."
        )
    if isinstance(row, FigureChange):
        before, after = (_median_text(row, value) for value in (row.medians[0], row.medians[-1]))
        what = f"{row.label}, {before} → {after}"
    else:
        what = f"runs that passed, {_count(row.tallies[0])} → {_count(row.tallies[-1])}"
    detail = f"{what} at {row.cell} (adjusted p {_probability(row.adjusted)})"
    if row.change in (Change.BETTER, Change.WORSE):
        return f"`{trend.results[-1].name}` is {row.change.value}: {detail}."
    return f"No difference is significant; the nearest is {detail}."


def _primary_table(trend: Trend, names: Sequence[str]) -> str:
    if not trend.primary:
        return ""
    rows = [(_figure_row(row), row.change) for row in trend.primary]
    columns = ("figure", "cell", *names, "p", "adjusted", "")
    return f"<h2>Primary figures, medians</h2>{_render_marked(columns, rows)}"


def _course(trend: Trend) -> str:
    """Render charts over the results. Two results have none, because a line between two points says nothing."""
    if len(trend.results) <= 2:
        return ""
    return f"<h2>Course over the results</h2>{room('trend', trend_charts(trend), first=_FIRST_CHARTS)}"


def _setting_table(trend: Trend, names: Sequence[str]) -> str:
    if not trend.settings:
        return ""
    rows = [(one.key, one.before, one.after) for one in trend.settings]
    return f"<h2>Settings that differ</h2>{cells(('setting', names[0], names[-1]), rows, 'narrow settings')}"


def _cells(trend: Trend) -> tuple[Sequence[CellChange], Sequence[CellChange]]:
    """Return the row over all cells with the cells that differ, and the cells that are the same in all results. A
    single cell has no row over all cells.
    """
    if len(trend.cells) == 1:
        return trend.cells, ()
    differing = [row for row in trend.cells if len(set(map(_count, row.tallies))) > 1]
    return [trend.overall, *differing], [row for row in trend.cells if row not in differing]


def _cell_tables(trend: Trend, names: Sequence[str]) -> str:
    """Render the counts of runs by cell; the cells that are the same in all results are folded."""
    columns = ("cell", *names, "p", "adjusted", "")
    differing, same = (
        _render_marked(columns, [(_cell_row(row), row.change) for row in rows]) if rows else ""
        for rows in _cells(trend)
    )
    count = len(_cells(trend)[1])
    return differing + fold(f"<h2>{count} more cells, the same in all results</h2>{same}" * bool(same))


def _cell_row(row: CellChange) -> tuple[str, ...]:
    counts = map(_count, row.tallies)
    return row.cell, *counts, _probability(row.probability), _probability(row.adjusted), row.change.value


def _count(tally: Tally) -> str:
    return f"{tally.passed}/{tally.total}" if tally.total else UNKNOWN


def _figure_row(row: FigureChange) -> tuple[str, ...]:
    medians = (
        "∞" if count and median is None else _median_text(row, median, interval)
        for count, median, interval in zip(row.runs, row.medians, row.intervals, strict=True)
    )
    test = _probability(row.probability), _probability(row.adjusted), row.change.value
    return row.label, row.cell, *medians, *test


def _median_text(row: FigureChange, median: float | None, interval: tuple[float, float] | None = None) -> str:
    """Format a median, with its interval if there is one."""
    definition = FIGURES[row.figure]

    def text(value: float | None, unit: str) -> str:
        return concise(value, definition.scale, definition.form, unit)

    if interval is None or interval[0] == interval[1]:
        return text(median, definition.unit)
    return f"{text(median, definition.unit)} ({text(interval[0], '')} … {text(interval[1], '')})"


def _probability(value: float | None) -> str:
    if value is None:
        return UNKNOWN
    return f"{value:.3f}" if value >= 0.001 else f"{value:.0e}"


def _significance(row: CellChange | FigureChange) -> tuple[float, float, float]:
    """Return a key that sorts rows by significance, and equally significant figures by their relative change."""
    change = 0.0
    if isinstance(row, FigureChange):
        first, last = row.medians[0], row.medians[-1]
        change = 1.0
        if first is not None and last is not None:
            change = abs(last - first) / ((abs(first) + abs(last)) or 1.0)
    return (
        2.0 if row.adjusted is None else row.adjusted,
        2.0 if row.probability is None else row.probability,
        -change,
    )


def _figure_tables(trend: Trend, names: Sequence[str]) -> str:
    """Render the figures that differ, the most significant first; most of those that are not significant are folded."""
    rows = sorted(trend.figures, key=_significance)
    if not rows:
        return "<p>Every figure is the same in all results.</p>"
    columns = ("figure", "cell", *names, "p", "adjusted", "")
    first = max(FIRST_FIGURES, sum(row.change is not Change.NONE for row in rows))
    marked = [(_figure_row(row), row.change) for row in rows]
    more = f"<h2>{len(rows) - first} more figures</h2>{_render_marked(columns, marked[first:])}"
    return _render_marked(columns, marked[:first]) + (fold(more) if len(rows) > first else "")


def _render_marked(columns: Sequence[str], rows: Sequence[tuple[Sequence[str], Change]]) -> str:
    """Render a table whose last column is coloured by the change in it. On a phone, each value has the title of its
    column.
    """
    numeric = ["" if name in _TEXT_COLUMNS else "count" for name in columns]
    head = "".join(
        f'<th class="{style}">{escape(name)}</th>' for style, name in zip(numeric, columns, strict=True)
    )

    def field(title: str, text: str, style: str) -> str:
        return f'<td class="{style}" data-title="{escape(title)}">{escape(text)}</td>'

    body = [
        "".join(field(*one) for one in zip(columns, texts[:-1], numeric, strict=False))
        + field("", texts[-1], _CLASSES[change])
        for texts, change in rows
    ]
    return across(table(body, "narrow steps", f"<thead><tr>{head}</tr></thead>"))


def trend_charts(trend: Trend) -> Charts:
    """Return charts of the share of runs that passed, and of the medians of figures, over the results in their
    order.

    A cell has one colour in all charts. If there are more cells than colours, the cells with the most significant
    changes are drawn.
    """
    ranked = sorted(trend.cells, key=lambda row: 2.0 if row.probability is None else row.probability)
    drawn = {row.cell for row in ranked[:SERIES_MOST]}
    colours = {
        cell: f"{place + 1}"
        for place, cell in enumerate(one.cell for one in trend.cells if one.cell in drawn)
    }
    sources: dict[str, dict[str, Sequence[float | None]]] = {}
    charts = []

    def add(
        name: str, title: str, unit: str, lines: Mapping[str, Sequence[float | None]], zero: bool = False
    ) -> None:
        chosen = {cell: lines[cell] for cell in colours if cell in lines}
        sources[name] = {
            "x": list(map(float, range(len(trend.results)))),
            **{colours[c]: v for c, v in chosen.items()},
        }
        series = [Series(name, colours[cell], cell, colours[cell], width=2.0) for cell in chosen]
        if series:
            charts.append(Chart(name, title, unit, series, axis=_PLACE, height_px=170, zero=zero))

    add(
        "passed",
        "Runs that passed",
        "%",
        {row.cell: [_share(one) for one in row.tallies] for row in trend.cells},
        zero=True,
    )
    by_figure: dict[str, dict[str, Sequence[float | None]]] = {}
    for row in (*trend.primary, *sorted(trend.figures, key=_significance)):
        by_figure.setdefault(row.figure, {})[row.cell] = row.medians
    for key, medians in list(by_figure.items())[:CHARTS_MOST]:
        add(key, f"Median: {FIGURES[key].words}", FIGURES[key].unit, medians)
    axis = Axis("results", "", names=[one.name for one in trend.results])
    return Charts({_PLACE: axis}, charts, sources)


def _share(tally: Tally) -> float | None:
    return 100.0 * tally.passed / tally.total if tally.total else None
