"""Tables as files: CSV and Parquet. Times are seconds on the run's clock.

An unknown value is an empty cell in CSV, and null in Parquet.
"""

import csv
import io
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

from hil_bridge.errors import ConfigError
from hil_bridge.errors.extras import install_command
from hil_bridge.record import CycleRecord, SensorRecord
from hil_bridge.record.analysis.columns import Columns, column_names, plain, unit_of
from protocol.geometry import Wrench
from protocol.wrench import wrench_of

TIME = "time_s"
"""Name of the first column: time on the run's clock, s. For a cycle, it is the time of the decision."""
COLUMNS_MAX = 1000
"""Maximum number of columns in a table. Chosen: ten times the usual number, because a controller may add
explanation values.
"""
Table: TypeAlias = Mapping[str, Sequence[Any]]
"""Values of each column by its name: numbers, texts, and None for unknown values."""


def cycle_table(cycles: Sequence[CycleRecord]) -> Table:
    """Return every field of every control cycle. Raises ConfigError if there are more than `COLUMNS_MAX` columns."""
    arrays = Columns(cycles, CycleRecord)
    columns = {TIME: arrays["controlled_at"], **arrays.flat()}
    if len(columns) > COLUMNS_MAX:
        raise ConfigError(
            f"the cycles have {len(columns)} columns, a table at most {COLUMNS_MAX}: reduce the explanation "
            "values of the controller"
        )
    return {name: plain(values.tolist()) for name, values in columns.items()}


def sensor_table(sensors: Sequence[SensorRecord], scales: Wrench | None) -> Table:
    """Return every frame of the sensor: its device counts, and its wrench if the scales are known."""
    columns: dict[str, list[Any]] = {
        TIME: [one.at for one in sensors],
        "sequence": [one.sequence for one in sensors],
    }
    readings: dict[str, list[Sequence[float]]] = {"counts": [one.counts for one in sensors]}
    if scales:
        readings = {"wrench": [wrench_of(counts, scales) for counts in readings["counts"]], **readings}
    for field, values in readings.items():
        columns |= {name: [six[k] for six in values] for k, name in enumerate(column_names(field, 6))}
    return {name: plain(values) for name, values in columns.items()}


def as_csv(table: Table) -> bytes:
    """Return comma-separated values with a header line.

    Numbers have all digits, so that a reader gets the exact values.
    """
    file = io.StringIO(newline="")
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(table)
    writer.writerows(zip(*table.values(), strict=True))
    return file.getvalue().encode(errors="backslashreplace")


def as_parquet(table: Table) -> bytes:
    """Return a Parquet file for pandas, Polars, DuckDB and similar libraries.

    The metadata of a column contain its unit. Raises ConfigError if pyarrow is not installed.
    """
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError as error:
        raise ConfigError(
            f"Parquet needs the package pyarrow; {install_command('parquet')}, or export csv"
        ) from error
    arrow = pyarrow.table(dict(table))
    fields = [field.with_metadata({"unit": unit_of(field.name)}) for field in arrow.schema]
    sink = pyarrow.BufferOutputStream()
    parquet.write_table(arrow.cast(pyarrow.schema(fields)), sink)
    data: bytes = sink.getvalue().to_pybytes()
    return data
