"""Validation of a device kind that a plug-in provides, before it is used."""

import dataclasses
import math
import re
from collections.abc import Iterator
from typing import Any

from hil_bridge.errors.failures import failure

_NAME = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")
_CALLED = {"RobotKind": ("connect", "facts"), "SensorKind": ("connect",), "SurfaceKind": ("make",)}
"""Attributes that must be callable, by type of device kind."""
_CALLED_OF_EMULATION = ("make", "serve", "usual")


def fault_of(kind: Any, reserved: frozenset[str]) -> str:
    """Return a description of the first fault of a device kind, or "" if the kind is valid. `reserved` contains the
    reserved section names.
    """
    return next(_faults(kind, reserved), "")


def _faults(kind: Any, reserved: frozenset[str]) -> Iterator[str]:
    if not _NAME.fullmatch(kind.name):
        yield f"its name {kind.name!r} must be lower-case letters, digits and hyphens, beginning with a letter"
    if kind.name.replace("-", "_") in reserved:
        yield f"its section [cell.{kind.name.replace('-', '_')}] is reserved; choose another name"
    for name in _CALLED[type(kind).__name__]:
        if not callable(getattr(kind, name)):
            yield f"its {name} is not callable"
    yield from settings_faults(kind.settings, "settings")
    emulation = getattr(kind, "emulation", None)
    if emulation is None:
        return
    for name in _CALLED_OF_EMULATION:
        if not callable(getattr(emulation, name, None)):
            yield f"its emulation.{name} is not callable"
    yield from settings_faults(getattr(emulation, "settings", None), "emulation.settings")


def settings_faults(settings: Any, what: str) -> Iterator[str]:
    """Yield the faults of a settings dataclass. Each field must have a default, and no default may be NaN."""
    if not (isinstance(settings, type) and dataclasses.is_dataclass(settings)):
        yield f"its {what} must be a dataclass, got {_word(settings)}"
        return
    for field in dataclasses.fields(settings):
        no_default = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        if field.init and no_default:
            yield f"its {what} must have a default for each field; {field.name} has none"
        if isinstance(field.default, float) and math.isnan(field.default):
            yield f"its {what} must not have NaN as a default; {field.name} is NaN"
    try:
        settings()
    except (Exception, SystemExit) as error:
        yield f"its {what} cannot be created from its defaults: {failure(error)}"


def _word(thing: Any) -> str:
    return thing.__name__ if isinstance(thing, type) else repr(thing)[:60]
