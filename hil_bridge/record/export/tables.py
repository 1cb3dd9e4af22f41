"""Tables as files: CSV and Parquet. Times are seconds of the run's clock.

What is not known is an empty cell of a CSV file, and null in Parquet.
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
"""The first column: the run's clock, s; of a cycle when it was decided."""
COLUMNS_MAX = 1000
"""Of a table. Chosen: ten times those of a usual run; a controller may explain itself with names of its own."""
Table: TypeAlias = Mapping[str, Sequence[Any]]
"""Values of each column by its name: numbers, texts, and None for what is not known."""


def cycle_table(cycles: Sequence[CycleRecord]) -> Table:
    """Every field of every control cycle. Raises ConfigError for more columns than a table may have."""
    arrays = Columns(cycles, CycleRecord)
    columns = {TIME: arrays["controlled_at"], **arrays.flat()}
    if len(columns) > COLUMNS_MAX:
        raise ConfigError(
            f"the cycles have {len(columns)} columns, a table at most {COLUMNS_MAX}: the controller explains itself "
            "with too many names"
        )
    return {name: plain(values.tolist()) for name, values in columns.items()}


def sensor_table(sensors: Sequence[SensorRecord], scales: Wrench | None) -> Table:
    """Every frame of the sensor: its wrench where the scales are known, and as the device counts."""
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
    """Comma-separated, with a line of names; numbers are told whole, so that reading them gives the same."""
    file = io.StringIO(newline="")
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(table)
    writer.writerows(zip(*table.values(), strict=True))
    return file.getvalue().encode(errors="backslashreplace")


def as_parquet(table: Table) -> bytes:
    """For pandas, Polars, DuckDB and the like. A column's unit is in its metadata. Raises ConfigError where pyarrow is
    not installed.
    """
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError as error:
        raise ConfigError(
            f"Parquet needs the package pyarrow; {install_command('parquet')}, or export csv"
        ) from error
    found = pyarrow.table(dict(table))
    fields = [field.with_metadata({"unit": unit_of(field.name)}) for field in found.schema]
    sink = pyarrow.BufferOutputStream()
    parquet.write_table(found.cast(pyarrow.schema(fields)), sink)
    data: bytes = sink.getvalue().to_pybytes()
    return data
