"""Table of causes as text: on a terminal, and as cells for the page of safety."""

import textwrap
from collections.abc import Iterable, Sequence

from hil_bridge.errors.cause_row import CauseRow, When
from hil_bridge.errors.cause_table import TABLE

HEAD = ("name", "condition", "settings", "looked at", "reaction", "exit code", "part at fault")
"""Head of the table, as `cells` fills it."""


def cells(row: CauseRow) -> tuple[str, str, Sequence[str], str, str, str, str]:
    """Return a row of the table as text; the settings one by one."""
    code = "" if row.exit_code is None else str(row.exit_code)
    part = str(row.part).replace("-", " ")
    return row.cause.value, row.condition, row.settings, row.when.value, row.reaction.value, code, part


_NAME, _WIDTH = 21, 110
"""Characters of the first column and of a line on a terminal."""


def as_text(rows: Iterable[CauseRow] = TABLE) -> Iterable[str]:
    """Return the table as lines for a terminal: a head for each time of checking, then a paragraph per row."""
    rows = tuple(rows)
    for when in When:
        seen = [row for row in rows if row.when is when]
        if not seen:
            continue
        yield f"{when.value}:"
        for row in seen:
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
