"""`dataclass` as in the standard library; a frozen, slotted one is made three times as quickly.

Every telegram, frame and event is such a value, and a control cycle makes dozens. The standard library
freezes a class by a `__setattr__` that raises, which its own `__init__` then has to go around, one function call a
field. Here `__new__` fills a *draft*, a class of the same layout that is not frozen, and turns it into the value by its
`__class__`. Nothing else differs: equality, hash, `replace`, `fields`, matching, copying and pickling are the standard
library's.
"""

import dataclasses
import inspect
import types
from collections.abc import Callable
from enum import Enum
from typing import TYPE_CHECKING, Any, TypeVar

Class = TypeVar("Class", bound=type[Any])

_INDENT = "\n    "


class _Sign(Enum):
    """Stands for a default that is made anew for every value."""

    FACTORY = "<factory>"

    def __repr__(self) -> str:
        return str(self.value)


def _quick(kind: Class) -> Class:
    """Give a frozen, slotted dataclass that has no `__init__` a quick `__new__`."""
    names: dict[str, Any] = {
        "__name__": kind.__module__,  # what a profile counts it for
        "_draft": _draft(kind),
        "_new": object.__new__,
        "_factory": _Sign.FACTORY,
    }
    positional, lines = ["cls"], ["self = _new(_draft)"]
    keywords: list[str] = []
    for field in dataclasses.fields(kind):
        name, value = field.name, field.name
        default = ""
        if field.default is not dataclasses.MISSING:
            names[f"_default_{name}"], default = field.default, f"=_default_{name}"
        elif field.default_factory is not dataclasses.MISSING:
            names[f"_make_{name}"], default = field.default_factory, "=_factory"
            value = f"_make_{name}() if {name} is _factory else {name}"
        if field.init:
            (keywords if field.kw_only else positional).append(name + default)
        elif not default:
            continue  # left to __post_init__
        else:
            value = f"_make_{name}()" if default == "=_factory" else f"_default_{name}"
        lines.append(f"self.{name} = {value}")
    lines.append("self.__class__ = cls")
    if hasattr(kind, "__post_init__"):
        lines.append("self.__post_init__()")
    parameters = ", ".join([*positional, "*", *keywords] if keywords else positional)
    exec(f"def __new__({parameters}):{_INDENT}{_INDENT.join([*lines, 'return self'])}", names)
    new = names["__new__"]
    new.__qualname__ = f"{kind.__qualname__}.__new__"
    new.__annotations__ = {field.name: field.type for field in dataclasses.fields(kind)}
    made: Any = kind
    made.__new__, made.__reduce__ = new, _reduce
    return kind


def _draft(kind: type[Any]) -> type[Any]:
    """A class whose instances can become instances of this one, and can be written to until then."""
    namespace: dict[str, Any] = {
        "__slots__": kind.__dict__["__slots__"],
        "__module__": kind.__module__,
        "__setattr__": object.__setattr__,
        "__delattr__": object.__delattr__,
    }
    if "__orig_bases__" in kind.__dict__:
        namespace["__orig_bases__"] = kind.__dict__["__orig_bases__"]
    return types.new_class(
        f"{kind.__name__}Draft", kind.__bases__, exec_body=lambda names: names.update(namespace)
    )


def _reduce(self: Any) -> tuple[Any, ...]:
    """For copy and pickle: the value without its checks, which it has passed once."""
    return object.__new__, (type(self),), self.__getstate__()


if TYPE_CHECKING:
    from dataclasses import dataclass as dataclass
else:

    def dataclass(kind: type[Any] | None = None, /, **options: bool) -> Callable[[Class], Class] | type[Any]:
        """As `dataclasses.dataclass`, with the same options."""

        def make(kind: Class) -> Class:
            if not (options.get("frozen") and options.get("slots")) or "__init__" in kind.__dict__:
                return dataclasses.dataclass(**options)(kind)
            documented = kind.__doc__
            made = _quick(dataclasses.dataclass(**options, init=False)(kind))
            if documented is None:
                made.__doc__ = f"{made.__name__}{inspect.signature(made)}"
            return made

        return make if kind is None else make(kind)
