"""Faults of a kind of device that a plug-in offers, in words: looked at before it is used."""

import dataclasses
import math
import re
from collections.abc import Iterator
from typing import Any

from hil_bridge.errors.failures import failure

_NAME = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")
_CALLED = {"RobotKind": ("connect", "facts"), "SensorKind": ("connect",), "SurfaceKind": ("make",)}
"""Attributes that are called, by the type of the kind."""
_CALLED_OF_EMULATION = ("make", "serve", "usual")


def fault_of(kind: Any, taken: frozenset[str]) -> str:
    """The first thing that is wrong with a kind; empty where nothing is. `taken` are names of sections of others."""
    return next(_faults(kind, taken), "")


def _faults(kind: Any, taken: frozenset[str]) -> Iterator[str]:
    if not _NAME.fullmatch(kind.name):
        yield f"its name {kind.name!r} must be small letters, digits and hyphens, a letter first"
    if kind.name.replace("-", "_") in taken:
        yield f"its section would be [cell.{kind.name.replace('-', '_')}], which is another's; choose another name"
    for name in _CALLED[type(kind).__name__]:
        if not callable(getattr(kind, name)):
            yield f"its {name} cannot be called"
    yield from settings_faults(kind.settings, "settings")
    emulation = getattr(kind, "emulation", None)
    if emulation is None:
        return
    for name in _CALLED_OF_EMULATION:
        if not callable(getattr(emulation, name, None)):
            yield f"its emulation.{name} cannot be called"
    yield from settings_faults(getattr(emulation, "settings", None), "emulation.settings")


def settings_faults(settings: Any, what: str) -> Iterator[str]:
    """Faults of a dataclass of settings: each of them must have a default, and none may be NaN."""
    if not (isinstance(settings, type) and dataclasses.is_dataclass(settings)):
        yield f"its {what} must be a dataclass, got {_word(settings)}"
        return
    for field in dataclasses.fields(settings):
        no_default = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        if field.init and no_default:
            yield f"its {what} must have a default for each field, {field.name} has none"
        if isinstance(field.default, float) and math.isnan(field.default):
            yield f"its {what} must have numbers as defaults, {field.name} is nan"
    try:
        settings()
    except (Exception, SystemExit) as error:
        yield f"its {what} cannot be made from the defaults: {failure(error)}"


def _word(thing: Any) -> str:
    return thing.__name__ if isinstance(thing, type) else repr(thing)[:60]
