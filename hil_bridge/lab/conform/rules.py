"""Parsing and description of the rules of a conformance test."""

from collections.abc import Iterator, Sequence
from dataclasses import Field, fields
from typing import Any, TypeVar

from hil_bridge.errors import ConfigError
from protocol.marks import settings

Rules = TypeVar("Rules")
"""Type of a dataclass of rules, for robots or for sensors."""


def read_rules(kind: type[Rules], assignments: Sequence[str], **declared: bool) -> Rules:
    """Parse rules from texts `NAME=VALUE`. Raises ConfigError for an invalid rule, and for a declaration that does
    not apply to this kind of device.
    """
    values: dict[str, float] = {}
    unknown = [name for name, is_set in declared.items() if is_set and name not in _names(kind)]
    if unknown:
        raise ConfigError(f"--{unknown[0].replace('_', '-')} does not apply to a client of this device")
    declared = {name: is_set for name, is_set in declared.items() if name in _names(kind)}
    numbers = [item.name for item in _fields(kind) if item.type in (float, "float")]
    for text in assignments:
        name, equals, value = text.partition("=")
        if not equals or name not in numbers:
            raise ConfigError(f"--set {text}: must be NAME=VALUE with one of {', '.join(numbers)}")
        try:
            values[name] = float(value)
        except ValueError as error:
            raise ConfigError(f"--set {text}: {value!r} is not a number") from error
    try:
        all_values: dict[str, Any] = {**values, **declared}
        return kind(**all_values)
    except ValueError as error:
        raise ConfigError(f"--set: {error}") from error


def describe_rules(rules: object) -> Iterator[str]:
    """Yield one line per rule."""
    for item in settings(rules):
        yield f"{item.name:16} {item.value!s:>8} {item.info.unit:5} {item.info.meaning}"


def _fields(kind: Any) -> "tuple[Field[Any], ...]":
    return fields(kind)


def _names(kind: Any) -> set[str]:
    return {item.name for item in _fields(kind)}
