"""Reader of the CSV files of experiments."""

import csv
import io

from paper_experiments.results import Row, Value


def from_csv(text: str) -> tuple[Row, ...]:
    """Return the rows of a table that `to_csv` wrote."""
    return tuple(
        {name: _value(field) for name, field in row.items()} for row in csv.DictReader(io.StringIO(text))
    )


def _value(field: str) -> Value:
    if not field:
        return None
    for kind in (int, float):
        try:
            return kind(field)
        except ValueError:
            continue
    return field
