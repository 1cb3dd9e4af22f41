"""Table of causes as text for a terminal, and as cells for the safety page."""

import textwrap
from collections.abc import Iterable, Sequence

from hil_bridge.errors.cause_row import CauseRow, When
from hil_bridge.errors.cause_table import TABLE

HEAD = ("name", "condition", "settings", "checked", "reaction", "exit code", "part at fault")
"""Column headings of the table whose rows `cells` returns."""


def cells(row: CauseRow) -> tuple[str, str, Sequence[str], str, str, str, str]:
    """Return a row of the table as text, with one entry per setting."""
    code = "" if row.exit_code is None else str(row.exit_code)
    part = str(row.part).replace("-", " ")
    return row.cause.value, row.condition, row.settings, row.when.value, row.reaction.value, code, part


_NAME, _WIDTH = 21, 110
"""Width of the first column and of a line on a terminal, in characters."""


def as_text(rows: Iterable[CauseRow] = TABLE) -> Iterable[str]:
    """Return the table as lines for a terminal: a heading for each time at which conditions are checked, then a
    paragraph per row.
    """
    rows = tuple(rows)
    for when in When:
        group = [row for row in rows if row.when is when]
        if not group:
            continue
        yield f"{when.value}:"
        for row in group:
            name, condition, settings, _, reaction, code, part = cells(row)
            ends = f", exit code {code}" if code else ""
            ruled = f"; {', '.join(settings)}" if settings else ""
            for text in (
                f"{name:<{_NAME}}{condition}",
                f"{'':<{_NAME}}→ {reaction}{ends}; at fault: {part}{ruled}",
            ):
                yield from textwrap.wrap(
                    text, _WIDTH, initial_indent="  ", subsequent_indent=" " * (_NAME + 4)
                )
        yield ""
