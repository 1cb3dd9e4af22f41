"""Tables of plain text: Markdown for build servers and documents, columns for a terminal."""

from collections.abc import Iterator, Sequence

_SPECIAL = str.maketrans({"|": "\\|", "<": "&lt;", "\n": " ", "\r": " "})
"""Signs that would end a cell of Markdown, or begin HTML in it."""


def markdown_table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Texts below titles as Markdown."""
    head, *body = (
        f"| {' | '.join(cell.translate(_SPECIAL) for cell in line)} |" for line in (columns, *rows)
    )
    return "\n".join((head, "|" + "---|" * len(columns), *body))


def aligned(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Texts below titles, each column as wide as its widest text."""
    lines = [columns, *rows]
    widths = [max(len(line[place]) for line in lines) for place in range(len(columns))]
    for line in lines:
        yield "  ".join(f"{text:{width}}" for text, width in zip(line, widths, strict=True)).rstrip()
