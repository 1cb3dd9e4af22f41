"""Records as NumPy arrays: one array per field, one row per record. This module also defines the column names.

Numbers become an array of their type, and an unknown number becomes NaN. Vectors, quaternions and wrenches become
an array with one column per component. Values by name (`explanation`) become a mapping from name to array. Other
values become an array of objects. The fields of a cycle's sample are listed with the fields of the cycle. A sample
field that has the same name as a field of the cycle gets the prefix `sample_`.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from importlib import import_module
from operator import attrgetter
from typing import Any, TypeAlias

import numpy as np
from msgspec import Struct, inspect
from numpy.typing import NDArray

from hil_bridge.errors import ConfigError
from protocol.wrench import AXES

Column: TypeAlias = Any
"""Values of a field: an array, or a mapping from name to array."""
_NAN = float("nan")
_HTML_ROWS, _HTML_COLUMNS = 4, 10
"""Maximum number of rows at each end and of columns in the table of a notebook. Chosen."""
_PARTS: Mapping[int, Sequence[str]] = {3: ("x", "y", "z"), 4: ("w", "x", "y", "z"), 6: AXES}
"""Component names of a vector, a quaternion and a wrench, by number of components."""
_UNITS: Mapping[str, str] = {
    **dict.fromkeys(("force", "force_reference", "paired_force", "witness", "hidden", "resultant"), "N"),
    **dict.fromkeys(("force_travel", "force_across", "peak_force", "peak_resultant"), "N"),
    **dict.fromkeys(("position", "target", "start", "depth", "depth_commanded", "correction"), "m"),
    **dict.fromkeys(("travel_commanded", "across_commanded", "deflection"), "m"),
    **dict.fromkeys(("now", "answer_s", "gap", "unchanged", "overdue"), "s"),
    "peak_moment": "N·m",
    "stiffness": "N/m",
    "joints_deg": "deg",
    "tilt": "rad",
}
"""Unit of each field, as stated in the docstring of the field."""
_UNITS_BY_SUFFIX: Mapping[str, str] = {"n": "N", "nm": "N·m", "m": "m", "at": "s", "s": "s", "deg": "deg"}
"""Unit of every other column, by the suffix of its name."""


def column_names(field: str, parts: int) -> Sequence[str]:
    """Return the column names of an array with this number of components: axes, or joint numbers from 1."""
    ends = range(1, parts + 1) if field.startswith("joints") else _PARTS.get(parts, range(parts))
    return [f"{field}_{end}" for end in ends]


def unit_of(column: str) -> str:
    """Return the unit of a column; empty if the column has no unit."""
    column = column.removeprefix("sample_")
    field, _, part = column.rpartition("_")
    if field == "wrench":
        return "N" if part.startswith("f") else "N·m"
    return _UNITS.get(column) or _UNITS.get(field) or _UNITS_BY_SUFFIX.get(part, "")


class Columns(Mapping[str, Column]):
    """Arrays of records of one type, by field name. Each array is built on first access.

    The arrays are read-only. `count` is the number of records, and `len` is the number of arrays.
    """

    def __init__(self, records: Sequence[Struct], kind: type[Struct]) -> None:
        self._records = records
        self._widths: dict[str, int] = {}
        """Number of columns of each field, which is the number of its components; 0 for a field that is not a row
        of numbers.
        """
        self._paths: dict[str, str] = {}
        """Path of each field in its record, such as `sample.now`."""
        for name, path, field in _fields(inspect.type_info(kind)):
            self._widths[name], self._paths[name] = _width(field.type), path
        self._made: dict[str, Column] = {}

    @property
    def count(self) -> int:
        """Number of records."""
        return len(self._records)

    def __len__(self) -> int:
        """Return the number of arrays."""
        return len(self._widths)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.count} records of {', '.join(self)}>"

    def _repr_html_(self) -> str:
        """Return the first and last records as an HTML table for a notebook, limited to the columns that fit."""
        flat = list(self.flat().items())
        visible, rows = flat[:_HTML_COLUMNS], range(self.count)
        picked = [*rows[:_HTML_ROWS], *rows[max(_HTML_ROWS, self.count - _HTML_ROWS) :]]
        head = "".join(f"<th>{escape(name)}</th>" for name, _ in visible)
        body = "".join(
            f"<tr><th>{row}</th>{''.join(f'<td>{escape(_cell(array[row]))}</td>' for _, array in visible)}</tr>"
            for row in picked
        )
        left = f", of {len(flat)} columns the first {len(visible)}" if len(flat) > len(visible) else ""
        table = f"<table><thead><tr><th></th>{head}</tr></thead><tbody>{body}</tbody></table>"
        return f"{table}<p>{self.count} records{left}</p>"

    def flat(self) -> dict[str, NDArray[Any]]:
        """Columns of the records, one array (n,) per column.

        `position` becomes `position_x` and so on; a named value becomes `explanation_NAME`.
        """
        return {name: values for _, name, values in self.named()}

    def named(self) -> Iterator[tuple[str, str, NDArray[Any]]]:
        """Field, name and values of each column, in order."""
        for field, column in self.items():
            if isinstance(column, Mapping):
                yield from ((field, f"{field}_{key}", values) for key, values in column.items())
            elif column.ndim == 2:
                names = column_names(field, column.shape[1])
                yield from ((field, name, column[:, part]) for part, name in enumerate(names))
            else:
                yield field, field, column

    def path(self, name: str) -> str:
        """Return the path of a field in its record, such as `sample.now`."""
        return self._paths[name]

    def to_pandas(self) -> Any:
        """Return a pandas DataFrame of `flat`. Raises ConfigError if pandas is not installed."""
        return _library("pandas").DataFrame(self.flat())

    def to_polars(self) -> Any:
        """Return a polars DataFrame of `flat`; values other than numbers and text are converted to text.

        Raises ConfigError if polars is not installed.
        """
        return _library("polars").DataFrame(
            {name: plain(values.tolist()) for name, values in self.flat().items()}, strict=False
        )

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names of the arrays."""
        return iter(self._widths)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._widths]

    def __getitem__(self, name: str) -> Column:
        """Return the array of a field. Raises KeyError for an unknown name."""
        if name not in self._widths:
            raise KeyError(f"unknown field {name!r}; known: {', '.join(self._widths)}")
        if name not in self._made:
            read = attrgetter(self._paths[name])
            self._made[name] = _column([read(record) for record in self._records], self._widths[name])
        return self._made[name]

    def __getattr__(self, name: str) -> Column:
        """Return the array of a field. Raises AttributeError for an unknown name."""
        if name.startswith("_"):  # for example on an object that is being copied
            raise AttributeError(name)
        try:
            return self[name]
        except KeyError as error:
            raise AttributeError(str(error.args[0])) from None


def _library(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError:
        raise ConfigError(f"{name} is not installed; run: pip install {name}") from None


def plain(column: Sequence[Any]) -> list[Any]:
    """Return the values of a column as numbers and texts; unknown values become None."""
    return [_plain(value) for value in column]


def _plain(value: Any) -> Any:
    match value:
        case float():
            return value if math.isfinite(value) else None
        case tuple():
            return "; ".join(map(str, value))
        case None | bool() | int() | str():
            return value
        case _:
            return str(value)


def _fields(kind: Any) -> Iterator[tuple[str, str, inspect.Field]]:
    """Return name, path and field of each column of a record. The fields of the sample replace the sample itself."""
    own = {field.name for field in kind.fields}
    for field in kind.fields:
        if field.name != "sample":
            yield field.name, field.name, field
            continue
        for name, path, inner in _fields(field.type):
            yield f"sample_{name}" if name in own else name, f"sample.{path}", inner


def _cell(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _column(values: list[Any], width: int) -> Column:
    if width:
        rows = [value or (_NAN,) * width for value in values]
        return _read_only(np.array(rows, dtype=float).reshape(len(rows), width))
    if any(isinstance(value, Mapping) for value in values):
        names = dict.fromkeys(name for value in values for name in value)
        return {name: _numbers([value.get(name) for value in values]) for name in names}
    if all(value is None or isinstance(value, (bool, int, float)) for value in values):
        return _numbers(values)
    if all(isinstance(value, str) for value in values):
        return _read_only(np.array([str(value) for value in values], dtype=object))
    objects = np.empty(len(values), dtype=object)
    objects[:] = values
    return _read_only(objects)


def _numbers(values: list[Any]) -> NDArray[Any]:
    """Return one number per record; None becomes NaN."""
    if any(value is None for value in values):
        return _read_only(np.array([_NAN if value is None else value for value in values], dtype=float))
    return _read_only(np.array(values))


def _width(kind: inspect.Type) -> int:
    """Return how many numbers each value of a field has; 0 if it is not a fixed-length row of numbers."""
    match kind:
        case inspect.TupleType(item_types=parts):
            width = len(parts)
        case inspect.VarTupleType(item_type=inspect.UnionType(types=parts), max_length=most):
            width = most or 0
        case inspect.VarTupleType(item_type=part, max_length=most):
            parts, width = (part,), most or 0
        case _:
            return 0
    return width if all(isinstance(part, (inspect.FloatType, inspect.IntType)) for part in parts) else 0


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    array.flags.writeable = False
    return array
