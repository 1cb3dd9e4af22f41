"""Tables as HTML."""

import re
from collections.abc import Iterable, Sequence
from html import escape

from hil_bridge.show.report.figures import Row

_COMMAND = re.compile(r"`([^`]+)`")


def prose(text: str) -> str:
    """Sentences for people: without what follows the `?` of a URL, and commands between backticks as such."""
    return _COMMAND.sub(r"<code>\1</code>", escape(text))


def rows(figures: Iterable[Row]) -> str:
    """Figures with their explanations."""
    return table(
        (
            f'<td>{escape(row.label)}</td><td class="value">{escape(row.value)}</td>'
            f'<td class="note">{escape(row.explanation)}</td>'
            for row in figures
        ),
        "stack",
    )


def pairs(named: Iterable[tuple[str, str]], style: str = "narrow") -> str:
    """Names and values."""
    return table(
        (f'<td>{escape(name)}</td><td class="value">{escape(value)}</td>' for name, value in named), style
    )


def cells(titles: Sequence[str], lines: Iterable[Sequence[str]], style: str) -> str:
    """Plain texts below titles."""
    head = "<thead><tr>" + "".join(f"<th>{escape(title)}</th>" for title in titles) + "</tr></thead>\n"
    body = ("".join(f"<td>{escape(text)}</td>" for text in line) for line in lines)
    return across(table(body, style, head))


def across(marked: str) -> str:
    """A part that is wider than a phone, and moves sideways by itself."""
    return f'<div class="across">{marked}</div>'


def table(marked: Iterable[str], style: str = "wide", head: str = "") -> str:
    """Rows of `td` elements, already escaped."""
    body = "".join(f"<tr>{row}</tr>\n" for row in marked)
    return f'<table class="{style}">{head}<tbody>{body}</tbody></table>' if body else "<p>none</p>"
