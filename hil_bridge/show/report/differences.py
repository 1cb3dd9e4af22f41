"""Differences of a recorded configuration from the defaults, and between the configurations of runs."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from pydantic import ValidationError

from hil_bridge.errors import ConfigError
from hil_bridge.record.device_facts import recorded_configuration
from hil_bridge.record.reader import Recording
from hil_bridge.settings.configuration import Config, dump, read_config

_LENGTH_MAX = 300
"""Maximum number of characters of a displayed value. Chosen: the steps of a program are longer; the recording
contains them in full.
"""
_CHOICES = ("emulated", "surface_kind")
"""Keys that select a kind of device; the defaults are those of the selected kind."""
ABSENT = "–"
"""Text for the value of a setting that a run does not have."""
_LEVELS_MAX = 40
"""Maximum number of levels of nested tables."""


def from_defaults(recording: Recording) -> list[tuple[str, str, str]]:
    """Return key, value and default of every setting that differs from its default, for the selected devices.

    A key that this version does not know has an empty default.
    """
    recorded = flat(recorded_configuration(recording))
    defaults = flat(_defaults(recorded_configuration(recording)))
    plain = flat(json.loads(dump(Config())))
    for key in recorded:
        if key.rpartition(".")[2] in _CHOICES and key in plain:
            defaults[key] = plain[key]
    return [
        (key, describe_value(value), describe_value(defaults[key]) if key in defaults else "")
        for key, value in sorted(recorded.items())
        if key not in defaults or defaults[key] != value
    ]


def between(recordings: list[Recording]) -> list[tuple[str, ...]]:
    """Return the key of every setting that differs, and its value in each recording, in words if it is not plain."""
    configurations = [flat(recorded_configuration(recording)) for recording in recordings]
    keys = sorted({key for one in configurations for key in one})
    rows = []
    for key in keys:
        values = [one.get(key, ...) for one in configurations]
        if any(value != values[0] for value in values):
            rows.append((key, *(_describe_setting(key, value) for value in values)))
    return rows


def flat(values: Mapping[str, Any]) -> dict[str, Any]:
    """Flatten nested tables into one table with dotted keys."""
    return dict(_flat("", values, 0))


def describe_value(value: object) -> str:
    """Format a value in one line, as JSON unless it is a printable text."""
    is_plain = isinstance(value, str) and value != "" and value.isprintable()
    text = str(value) if is_plain else json.dumps(value, ensure_ascii=False)
    return text if len(text) <= _LENGTH_MAX else f"{text[:_LENGTH_MAX]} … ({len(text)} characters)"


def _describe_setting(key: str, value: object) -> str:
    """Format the value of a setting in a recording; `...` stands for a setting that the recording does not have."""
    if value is ...:
        return ABSENT
    if value is None:
        return "default"
    if isinstance(value, list) and key in _WORDED and all(isinstance(one, dict) for one in value):
        return _WORDED[key](value) or "none"
    numbers = value if isinstance(value, list) else [value]
    if numbers and all(isinstance(one, float) for one in numbers):
        return ", ".join(repr(one).removesuffix(".0") for one in numbers)
    return describe_value(value)


def _describe_faults(faults: Sequence[Mapping[str, Any]]) -> str:
    return "; ".join(map(_describe_fault, faults))


def _describe_steps(steps: Sequence[Mapping[str, Any]]) -> str:
    """Describe the steps of a recorded program by their names; a repetition has its own in brackets."""
    parts = []
    for step in steps:
        inner = step.get("step")
        nested = isinstance(inner, list) and all(isinstance(one, dict) for one in inner)
        times = f" {step['times']} times" if step.get("times") else ""
        parts.append(f"{step.get('do')}{times}{f' ({_describe_steps(inner)})' if nested and inner else ''}")
    return ", ".join(parts)


def _describe_fault(fault: Mapping[str, Any]) -> str:
    """Describe a recorded `FaultConfig`: what happens where, when and for how long."""
    phase, after, condition = (fault.get(key) for key in ("phase", "after_s", "when"))
    if condition:
        begin = f"when {condition}{f' in {phase}' if phase else ''}{f', {after} s later' if after else ''}"
    else:
        begin = f"{after} s into {phase or 'the run'}" if after else f"at the start of {phase or 'the run'}"
    given = [f"for {fault['for_s']} s"] if fault.get("for_s") is not None else []
    given += [f"{name} {value}" for name, value in (fault.get("parameters") or {}).items()]
    return ", ".join([f"{fault.get('fault')} at the {fault.get('on')}", begin, *given]).replace(".0 s", " s")


_WORDED: Mapping[str, Callable[[Sequence[Mapping[str, Any]]], str]] = {
    "faults": _describe_faults,
    "task.step": _describe_steps,
}
"""Settings that are lists of tables, with the function that describes them in words."""


def _flat(before: str, values: Mapping[str, Any], depth: int) -> Iterator[tuple[str, Any]]:
    for key, value in values.items():
        name = f"{before}.{key}" if before else str(key)
        if isinstance(value, dict) and value and depth < _LEVELS_MAX:
            yield from _flat(name, value, depth + 1)
        else:
            yield name, value


def _defaults(recorded: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the defaults for the same devices, or the general defaults if those devices are unavailable."""
    chosen: dict[str, Any] = {}
    for section in ("robot", "sensor", "cell"):
        values = recorded.get(section)
        if isinstance(values, dict):
            chosen[section] = {
                key: value if key in _CHOICES else {}
                for key, value in values.items()
                if key in _CHOICES or isinstance(value, dict)
            }
    try:
        made = read_config(chosen)
    except (ValidationError, ConfigError):
        made = Config()
    defaults: Mapping[str, Any] = json.loads(dump(made))
    return defaults
