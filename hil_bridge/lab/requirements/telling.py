"""The matrix as lines of text, as CSV and as a page."""

import csv
import io
from collections.abc import Iterable, Iterator
from html import escape
from pathlib import Path
from urllib.parse import quote

from hil_bridge.lab.requirements.matrix import Matrix, Row, State, Tried
from hil_bridge.show.pages import document
from hil_bridge.show.report.markup import across, pairs, table

_TITLES = ("requirement", "text", "state", "test", "verdict", "reason", "recordings")
_REASON = 160
"""Chosen: characters of a reason that the page shows."""


def describe(matrix: Matrix) -> Iterator[str]:
    """Lines of text: a count, then each requirement that has not passed."""
    passed = matrix.count(State.PASSED)
    yield f"{passed} of {len(matrix.rows)} requirements passed"
    for row in matrix.rows:
        if row.state is not State.PASSED:
            yield f"  {row.requirement.name}  {row.state}{_by(row)}"
    for name, test in matrix.strangers:
        yield f"  {name}  is not in the list; {test.name} names it"


def _by(row: Row) -> str:
    """The first test that says why, with its words."""
    tests = [one for one in row.tests if one.state is row.state]
    if not tests:
        return ""
    first, more = tests[0], len(tests) - 1
    return (
        f": {first.name}{f': {first.reason}' if first.reason else ''}{f' (and {more} more)' if more else ''}"
    )


def as_csv(matrix: Matrix) -> bytes:
    """One line for each requirement and test; a requirement without a test has one line."""
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(_TITLES)
    for row in matrix.rows:
        about = (row.requirement.name, row.requirement.text, row.state)
        if not row.tests:
            writer.writerow(map(_plain, (*about, "", "", "", "")))
        for test in row.tests:
            rest = (test.name, test.state, test.reason, " ".join(test.recordings))
            writer.writerow(map(_plain, (*about, *rest)))
    return text.getvalue().encode()


def _plain(text: str) -> str:
    """A cell that no spreadsheet takes for a formula."""
    return f"'{text}" if text[:1] in ("=", "+", "-", "@", "\t", "\r") else text


def as_page(title: str, matrix: Matrix, place: Path, facts: Iterable[tuple[str, str]] = ()) -> bytes:
    """The matrix as a page that will lie at `place`; recordings are linked from there. `facts`, by name, tell of what
    and when it was made.
    """
    counts = "".join(
        f'<span class="badge {_BADGES[state]}">{matrix.count(state)} {escape(state)}</span> '
        for state in State
        if matrix.count(state)
    )
    rows = (line for row in matrix.rows for line in _lines(row, place))
    head = "<thead><tr>" + "".join(f"<th>{title}</th>" for title in _TITLES) + "</tr></thead>"
    strangers = "".join(
        f"<p>{escape(name)} is not in the list; {escape(test.name)} names it.</p>"
        for name, test in matrix.strangers
    )
    body = f"<h1>{escape(title)}</h1>\n<p>{counts}</p>\n{across(table(rows, 'narrow', head))}\n{strangers}"
    if told := list(facts):
        body += f"\n<h2>What it was made of</h2>\n{across(pairs(told))}"
    return document(title, body, charts=False).encode()


_CLASSES = {State.PASSED: "good", State.FAILED: "bad", State.SKIPPED: "quiet", State.NO_TEST: "bad"}
_BADGES = {State.PASSED: "good", State.FAILED: "bad", State.SKIPPED: "plain", State.NO_TEST: "bad"}


def _lines(row: Row, place: Path) -> Iterator[str]:
    about = (
        f"<td>{escape(row.requirement.name)}</td><td>{escape(row.requirement.text)}</td>"
        f'<td class="{_CLASSES[row.state]}">{escape(row.state)}</td>'
    )
    if not row.tests:
        yield f"{about}<td></td><td></td><td></td><td></td>"
    for number, test in enumerate(row.tests):
        before = about if number == 0 else "<td></td><td></td><td></td>"
        yield before + _cells(test, place)


def _cells(test: Tried, place: Path) -> str:
    links = " ".join(_link(recording, place) for recording in test.recordings)
    return (
        f'<td>{escape(test.name)}</td><td class="{_CLASSES[test.state]}">{escape(test.state)}</td>'
        f"<td>{escape(test.reason[:_REASON])}</td><td>{links}</td>"
    )


def _link(recording: str, place: Path) -> str:
    """A link that stays right when page and recordings move together."""
    path = Path(recording)
    try:
        near = path.resolve().relative_to(place.resolve().parent)
    except (ValueError, OSError):
        near = path
    return f'<a href="{escape(quote(near.as_posix()))}">{escape(path.name)}</a>'
