"""Plain-text tables: Markdown for build servers and documents, and aligned columns for a terminal."""

from collections.abc import Iterator, Sequence

_SPECIAL = str.maketrans({"|": "\\|", "<": "&lt;", "\n": " ", "\r": " "})
"""Replacements for characters that would end a Markdown cell, or begin HTML in it."""


def markdown_table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Format column titles and rows as a Markdown table."""
    head, *body = (
        f"| {' | '.join(cell.translate(_SPECIAL) for cell in line)} |" for line in (columns, *rows)
    )
    return "\n".join((head, "|" + "---|" * len(columns), *body))


def aligned(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Yield the lines of a table in which each column is as wide as its widest text."""
    lines = [columns, *rows]
    widths = [max(len(line[place]) for line in lines) for place in range(len(columns))]
    for line in lines:
        yield "  ".join(f"{text:{width}}" for text, width in zip(line, widths, strict=True)).rstrip()
