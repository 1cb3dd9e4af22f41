"""HTML tables of a report page."""

import re
from collections.abc import Iterable, Sequence
from html import escape
from typing import NamedTuple

from hil_bridge.show.report.figures import Row

_BADGE_STYLES = {"completed": "good", "stopped": "bad", "interrupted": "warn"}
_COMMAND = re.compile(r"`([^`]+)`|(hil-bridge (?:doctor|free|report|why)\b)")

_BREAKS = re.compile(r"([._])")


def prose(text: str) -> str:
    """Render prose as HTML: format commands and text between backticks as code."""
    return _COMMAND.sub(lambda one: f"<code>{one[1] or one[2]}</code>", escape(text))


def note(text: str) -> str:
    """Render a note in small print; empty without a text."""
    return f'<p class="quiet small">{escape(text)}</p>' if text else ""


def command(purpose: str, text: str) -> str:
    """Render a command, what it is for, and a button that copies it."""
    copy = f'<button type="button" data-copy aria-label="copy: {escape(text)}">Copy</button>'
    return f'<div class="command"><span>{escape(purpose)}</span><code>{escape(text)}</code>{copy}</div>'


def badge(outcome: str) -> str:
    """Render the outcome of a run."""
    return f'<span class="badge {_BADGE_STYLES.get(outcome, "")}">{escape(outcome)}</span>'


def rows(figures: Iterable[Row]) -> str:
    """Render rows of figures with their explanations."""
    return table(
        (
            f'<td>{escape(row.label)}</td><td class="value">{escape(row.value)}</td>'
            f'<td class="note">{escape(row.explanation)}</td>'
            for row in figures
        ),
        "stack",
    )


def pairs(named: Iterable[tuple[str, str]], style: str = "narrow") -> str:
    """Render a table of names and values."""
    return table(
        (f'<td>{escape(name)}</td><td class="value">{escape(value)}</td>' for name, value in named), style
    )


def cells(titles: Sequence[str], lines: Iterable[Sequence[str]], style: str) -> str:
    """Render a table of plain texts below titles."""
    head = "<thead><tr>" + "".join(f"<th>{escape(title)}</th>" for title in titles) + "</tr></thead>\n"
    body = ("".join(f"<td>{escape(text)}</td>" for text in line) for line in lines)
    return across(table(body, style, head))


class Value(NamedTuple):
    """Value in a table, with a style and small print after it."""

    text: str
    style: str = ""
    note: str = ""


def stacked(titles: Sequence[str], lines: Iterable[Sequence[str | Value]], texts: int = 2) -> str:
    """Render a table whose first columns are `texts`, and the others are values. On a phone, each value is below the
    title of its column.
    """
    styles = ["text" if place < texts else "count" for place in range(len(titles))]
    head = "".join(
        f'<th class="{style}">{escape(title)}</th>' for title, style in zip(titles, styles, strict=True)
    )

    def field(title: str, style: str, cell: str | Value) -> str:
        text, more, note = Value(cell) if isinstance(cell, str) else cell
        small = f" <small>{escape(note)}</small>" if note else ""
        style = f"{style} {more}".rstrip()
        return f'<td class="{style}" data-title="{escape(title)}">{escape(text)}{small}</td>'

    body = ("".join(map(field, titles, styles, line)) for line in lines)
    style = "narrow stacked single" if len(titles) == texts + 1 else "narrow stacked"
    return across(table(body, style, f"<thead><tr>{head}</tr></thead>"))


def setting_cells(titles: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """Render a table of settings, whose names may break after a dot or an underscore, and their values."""
    head = f"<thead><tr>{''.join(f'<th>{escape(title)}</th>' for title in titles)}</tr></thead>"
    body = (
        "".join(f"<td>{text}</td>" for text in (_BREAKS.sub(r"\1<wbr>", escape(name)), *map(escape, texts)))
        for name, *texts in lines
    )
    return table(body, "narrow settings values", head)


def fold(section: str, name: str = "") -> str:
    """Fold a section below its heading, which the reader opens. An empty section stays empty.

    `name` is unique on the page; a live page keeps a named section open.
    """
    heading, end, rest = section.partition("</h2>")
    named = f' id="{name}"' if name else ""
    return (
        f'<details class="fold"{named}><summary>{heading}{end}</summary>\n{rest}</details>\n'
        if end
        else section
    )


def across(marked: str) -> str:
    """Wrap content that is wider than a phone, so that it scrolls sideways."""
    return f'<div class="across">{marked}</div>'


def table(marked: Iterable[str], style: str = "wide", head: str = "") -> str:
    """Render a table of `td` elements from escaped texts."""
    body = "".join(f"<tr>{row}</tr>\n" for row in marked)
    return f'<table class="{style}">{head}<tbody>{body}</tbody></table>' if body else "<p>none</p>"
