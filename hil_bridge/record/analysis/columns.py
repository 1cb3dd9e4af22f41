"""Records as NumPy arrays: a row a record, an array by the name of each field.

Numbers become an array of their type, with NaN for a number that is not known. Vectors, quaternions and wrenches become
an array with a column for each part. Values by name (`explanation`) become a mapping from the name to an array. What is
no number becomes an array of objects.
"""

from collections.abc import Iterator, Mapping, Sequence
from html import escape
from importlib import import_module
from typing import Any, TypeAlias

import numpy as np
from msgspec import Struct, inspect
from numpy.typing import NDArray

from hil_bridge.errors import ConfigError

Column: TypeAlias = Any
"""NDArray, or a mapping from names to NDArray."""
_NAN = float("nan")
_HTML_ROWS, _HTML_COLUMNS = 4, 10
"""Chosen: rows at each end, and columns, that a notebook has room for."""


class Columns(Mapping[str, Column]):
    """Arrays of records of one type, by the names of their fields; each is made when it is asked for first.

    They may not be written to. `count` is the number of records, `len` that of the arrays.
    """

    def __init__(self, records: Sequence[Struct], kind: type[Struct]) -> None:
        self._records = records
        self._widths = {field.name: _width(field.type) for field in inspect.type_info(kind).fields}  # type: ignore[attr-defined]
        """Columns of each field: of a vector, its parts; 0 for one that is no row of numbers."""
        self._made: dict[str, Column] = {}

    @property
    def count(self) -> int:
        """Number of records."""
        return len(self._records)

    def __len__(self) -> int:
        """Number of arrays."""
        return len(self._widths)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.count} records of {', '.join(self)}>"

    def _repr_html_(self) -> str:
        """The first and the last records as a table, for a notebook; of as many columns as have room."""
        flat = list(self.flat().items())
        shown, rows = flat[:_HTML_COLUMNS], range(self.count)
        picked = [*rows[:_HTML_ROWS], *rows[max(_HTML_ROWS, self.count - _HTML_ROWS) :]]
        head = "".join(f"<th>{escape(name)}</th>" for name, _ in shown)
        body = "".join(
            f"<tr><th>{row}</th>{''.join(f'<td>{escape(_cell(array[row]))}</td>' for _, array in shown)}</tr>"
            for row in picked
        )
        left = f", of {len(flat)} columns the first {len(shown)}" if len(flat) > len(shown) else ""
        table = f"<table><thead><tr><th></th>{head}</tr></thead><tbody>{body}</tbody></table>"
        return f"{table}<p>{self.count} records{left}</p>"

    def flat(self) -> dict[str, NDArray[Any]]:
        """One array (n,) a column: `position` becomes `position_0` and so on, a value by name `explanation_NAME`."""
        found: dict[str, NDArray[Any]] = {}
        for name, column in self.items():
            if isinstance(column, Mapping):
                found |= {f"{name}_{key}": values for key, values in column.items()}
            elif column.ndim == 2:
                found |= {f"{name}_{part}": column[:, part] for part in range(column.shape[1])}
            else:
                found[name] = column
        return found

    def to_pandas(self) -> Any:
        """A pandas DataFrame of `flat`. Raises ConfigError where pandas is not installed."""
        return _library("pandas").DataFrame(self.flat())

    def to_polars(self) -> Any:
        """A polars DataFrame of `flat`; what is no number or text is told as text. Raises ConfigError where polars is
        not installed.
        """
        plain = {
            name: list(map(_plain, values)) if values.dtype == object else values
            for name, values in self.flat().items()
        }
        return _library("polars").DataFrame(plain, strict=False)

    def __iter__(self) -> Iterator[str]:
        """Names of the arrays."""
        return iter(self._widths)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._widths]

    def __getitem__(self, name: str) -> Column:
        """The array of a field. Raises KeyError for a name that no field has."""
        if name not in self._widths:
            raise KeyError(f"no field is called {name!r}; there are {', '.join(self._widths)}")
        if name not in self._made:
            self._made[name] = _column(
                [getattr(record, name) for record in self._records], self._widths[name]
            )
        return self._made[name]

    def __getattr__(self, name: str) -> Column:
        """The array of a field. Raises AttributeError for a name that no field has."""
        if name.startswith("_"):  # as of an object that is being copied
            raise AttributeError(name)
        try:
            return self[name]
        except KeyError as error:
            raise AttributeError(str(error.args[0])) from None


def _library(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError:
        raise ConfigError(f"{name} is not installed here: pip install {name}") from None


def _plain(value: object) -> str | None:
    return None if value is None else str(value)


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
    """One number a record; NaN for None."""
    if any(value is None for value in values):
        return _read_only(np.array([_NAN if value is None else value for value in values], dtype=float))
    return _read_only(np.array(values))


def _width(kind: inspect.Type) -> int:
    """Numbers in each value of a field; 0 where it is no row of so many numbers."""
    parts = kind.item_type if isinstance(kind, inspect.VarTupleType) else None
    numbers = parts.types if isinstance(parts, inspect.UnionType) else (parts,)
    if not all(isinstance(part, (inspect.FloatType, inspect.IntType)) for part in numbers):
        return 0
    assert isinstance(kind, inspect.VarTupleType)
    return kind.max_length or 0


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    array.flags.writeable = False
    return array
