"""Records as NumPy arrays: a row a record, an array by the name of each field.

Numbers become an array of their type, with NaN for a number that is not known. Vectors, quaternions and wrenches become
an array with a column for each part. Values by name (`explanation`) become a mapping from the name to an array. What is
no number becomes an array of objects.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from msgspec import Struct, inspect
from numpy.typing import NDArray

Column: TypeAlias = Any
"""NDArray, or a mapping from names to NDArray."""
_NAN = float("nan")


class Columns:
    """Arrays of records of one type, by the names of their fields; each is made when it is asked for first.

    They may not be written to.
    """

    def __init__(self, records: Sequence[Struct], kind: type[Struct]) -> None:
        self._records = records
        self._widths = {field.name: _width(field.type) for field in inspect.type_info(kind).fields}  # type: ignore[attr-defined]
        """Columns of each field: of a vector, its parts; 0 for one that is no row of numbers."""
        self._made: dict[str, Column] = {}

    def __len__(self) -> int:
        """Number of records."""
        return len(self._records)

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
