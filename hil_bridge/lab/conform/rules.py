"""The rules of a trial, from a command line."""

from collections.abc import Iterator, Sequence
from dataclasses import fields
from typing import Any

from hil_bridge.errors import ConfigError
from hil_bridge.lab.conform.robots.scenarios import Rules
from protocol.marks import settings


def read_rules(given: Sequence[str], **declared: bool) -> Rules:
    """Rules with these `NAME=VALUE`. Raises ConfigError."""
    values: dict[str, float] = {}
    numbers = [item.name for item in fields(Rules) if item.type in (float, "float")]
    for text in given:
        name, equals, value = text.partition("=")
        if not equals or name not in numbers:
            raise ConfigError(f"--set {text}: write NAME=VALUE with one of {', '.join(numbers)}")
        try:
            values[name] = float(value)
        except ValueError as error:
            raise ConfigError(f"--set {text}: {value!r} is no number") from error
    try:
        given_all: dict[str, Any] = {**values, **declared}
        return Rules(**given_all)
    except ValueError as error:
        raise ConfigError(f"--set: {error}") from error


def describe_rules(rules: Rules) -> Iterator[str]:
    """One line a rule."""
    for item in settings(rules):
        yield f"{item.name:16} {item.value!s:>8} {item.info.unit:5} {item.info.meaning}"
