"""Values behave as the standard library's frozen, slotted dataclasses do."""

import copy
import dataclasses
import inspect
import pickle
from collections.abc import Callable
from dataclasses import FrozenInstanceError, field, replace
from typing import Any, ClassVar, Generic, TypeVar

import pytest

from protocol import values

Number = TypeVar("Number")


def classes(dataclass: Callable[..., Any]) -> dict[str, Any]:
    """The same declarations by either decorator."""
    frozen = dataclass(frozen=True, slots=True)

    @frozen
    class Pose:
        """A place."""

        UNIT: ClassVar[str] = "m"
        x: float
        y: float = 2.0
        tags: list[str] = field(default_factory=list)
        _hidden: int = field(default=7, init=False, repr=False)
        note: str = field(default="", kw_only=True, compare=False)

    @frozen
    class Named(Pose):
        name: str = "none"

        def __post_init__(self) -> None:
            if not self.name:
                raise ValueError("a pose needs a name")

    @frozen
    class Derived:
        side: float
        area: float = field(init=False)

        def __post_init__(self) -> None:
            object.__setattr__(self, "area", self.side**2)

    @frozen
    class Box(Generic[Number]):
        content: Number

    @frozen
    class Nothing:
        pass

    @frozen
    class Own:
        size: int

        def __init__(self, text: str) -> None:
            object.__setattr__(self, "size", len(text))

    @dataclass(frozen=True)
    class Loose:
        x: float = 1.0

    @dataclass
    class Open:
        x: float = 1.0

    kinds: dict[str, Any] = {k.__name__: k for k in (Pose, Named, Derived, Box, Nothing, Own, Loose, Open)}
    for name, kind in kinds.items():
        kind.__qualname__ = name
    return kinds


OURS, STANDARD = classes(values.dataclass), classes(dataclasses.dataclass)
MAKINGS: list[tuple[str, tuple[Any, ...], dict[str, Any]]] = [
    ("Pose", (1.0,), {}),
    ("Pose", (1.0, 3.0, ["a"]), {"note": "n"}),
    ("Pose", (), {"y": 5.0, "x": 4.0}),
    ("Named", (1.0,), {"name": "home"}),
    ("Named", (1.0, 2.0, [], "home"), {"note": "n"}),
    ("Derived", (3.0,), {}),
    ("Box", (5,), {}),
    ("Nothing", (), {}),
    ("Own", ("four",), {}),
    ("Loose", (), {}),
    ("Open", (2.0,), {}),
]
WRONG: list[tuple[str, tuple[Any, ...], dict[str, Any]]] = [
    ("Pose", (), {}),
    ("Pose", (1.0,), {"z": 1.0}),
    ("Pose", (1.0,), {"x": 1.0}),
    ("Pose", (1.0, 2.0, [], "n"), {}),
    ("Pose", (1.0,), {"_hidden": 1}),
    ("Named", (1.0,), {"name": ""}),
    ("Derived", (1.0, 1.0), {}),
    ("Nothing", (1,), {}),
]


def seen(value: Any) -> list[Any]:
    """What can be told of a value from outside."""
    names = [f.name for f in dataclasses.fields(value)]
    return [repr(value), [getattr(value, name) for name in names], dataclasses.asdict(value), kind_of(value)]


def kind_of(value: Any) -> list[Any]:
    kind = type(value)
    own = [f"{p.kind} {p.name}{'' if p.default is p.empty else ' default'}" for p in parameters(kind)]
    return [kind.__name__, kind.__qualname__, kind.__module__, kind.__match_args__, kind.__doc__, own]


def parameters(kind: Any) -> list[inspect.Parameter]:
    return list(inspect.signature(kind).parameters.values())


@pytest.mark.parametrize(("name", "arguments", "named"), MAKINGS)
def test_a_value_is_the_standard_librarys(
    name: str, arguments: tuple[Any, ...], named: dict[str, Any]
) -> None:
    ours, standard = (kinds[name](*arguments, **named) for kinds in (OURS, STANDARD))
    assert seen(ours) == seen(standard)
    again = OURS[name](*arguments, **named)
    assert (ours == again) is (standard == STANDARD[name](*arguments, **named)) is True
    assert ours != standard
    assert type(ours) is OURS[name]


@pytest.mark.parametrize(("name", "arguments", "named"), WRONG)
def test_what_cannot_be_made_is_refused_alike(
    name: str, arguments: tuple[Any, ...], named: dict[str, Any]
) -> None:
    refusals = []
    for kinds in (OURS, STANDARD):
        with pytest.raises((TypeError, ValueError)) as refusal:
            kinds[name](*arguments, **named)
        refusals.append(type(refusal.value))
    assert refusals[0] is refusals[1]


@pytest.mark.parametrize(("name", "arguments", "named"), MAKINGS[:7])
def test_a_value_is_frozen_and_slotted(name: str, arguments: tuple[Any, ...], named: dict[str, Any]) -> None:
    value = OURS[name](*arguments, **named)
    first = dataclasses.fields(value)[0].name
    for change in (lambda: setattr(value, first, 0), lambda: delattr(value, first)):
        with pytest.raises(FrozenInstanceError):
            change()
    assert not hasattr(value, "__dict__")


@pytest.mark.parametrize(("name", "arguments", "named"), MAKINGS[:8])
@pytest.mark.parametrize("again", [copy.copy, copy.deepcopy, lambda value: pickle.loads(pickle.dumps(value))])
def test_a_value_is_copied_and_pickled(
    name: str,
    arguments: tuple[Any, ...],
    named: dict[str, Any],
    again: Callable[[Any], Any],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    kind = OURS[name]
    monkeypatch.setitem(globals(), name, kind)  # where pickle finds it
    value = kind(*arguments, **named)
    other = again(value)
    assert other == value
    assert type(other) is kind
    assert seen(other) == seen(value)


def test_replace_and_matching() -> None:
    moved = replace(OURS["Named"](1.0, name="home", note="n"), y=9.0)
    assert (moved.x, moved.y, moved.name, moved.note) == (1.0, 9.0, "home", "n")
    with pytest.raises(ValueError, match="needs a name"):
        replace(moved, name="")
    pose: Any = OURS["Pose"]
    match moved:
        case pose(x, y):
            assert (x, y) == (1.0, 9.0)
        case _:
            pytest.fail("a derived value matches its base")


def test_a_default_made_anew_is_not_shared() -> None:
    first, second = OURS["Pose"](1.0), OURS["Pose"](1.0)
    first.tags.append("mine")
    assert second.tags == []


def test_equal_values_hash_alike() -> None:
    box = OURS["Box"]
    assert {box(1): "one"}[box(1)] == "one"
    assert hash(box(1)) == hash(STANDARD["Box"](1))


def test_a_class_without_a_docstring_gets_its_signature() -> None:
    class Point:
        x: int
        y: int = 0

    Again = type("Point", (), {"__annotations__": {"x": int, "y": int}, "y": 0})
    ours, standard = (
        values.dataclass(frozen=True, slots=True)(Point),
        dataclasses.dataclass(frozen=True)(Again),
    )
    assert ours.__doc__ == standard.__doc__ == "Point(x: int, y: int = 0)"
