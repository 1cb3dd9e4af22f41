"""`evolve` is `dataclasses.replace` for values whose fields are all parameters."""

from dataclasses import replace

import pytest

from hil_bridge.control.evolve import evolve
from protocol.values import dataclass


@dataclass(frozen=True, slots=True)
class Point:
    x: float
    y: float = 2.0
    tags: tuple[str, ...] = ("a",)


@pytest.mark.parametrize(
    "changes", [{}, {"x": 5.0}, {"tags": (), "x": 3.0}, {"y": 0.0, "x": 1.0, "tags": ("b",)}]
)
def test_it_changes_what_replace_changes_and_nothing_else(changes: dict[str, object]) -> None:
    point = Point(1.0, 7.0)
    assert evolve(point, **changes) == replace(point, **changes)  # type: ignore[arg-type]
    assert point == Point(1.0, 7.0)


def test_a_name_that_is_no_field_is_refused() -> None:
    with pytest.raises(TypeError, match="Point has no field z"):
        evolve(Point(1.0), z=1.0)
