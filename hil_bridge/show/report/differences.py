"""The recorded configuration as what differs from the defaults, or from another run's."""

import json
from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import ValidationError

from hil_bridge.errors import ConfigError
from hil_bridge.record.device_facts import recorded_configuration
from hil_bridge.record.reader import Recording
from hil_bridge.settings.configuration import Config, dump, read_config

_LONGEST = 300
"""Letters of a value that are shown. Chosen: a program's steps have more, and the recording holds them."""
_CHOICES = ("emulated", "surface_kind")
"""Keys that choose a kind, whose defaults are then those of that kind."""
_DEEPEST = 40
"""Tables inside tables that are followed."""


def from_defaults(recording: Recording) -> list[tuple[str, str, str]]:
    """Key, value and default of every setting that has another value than its default; of the devices chosen, theirs.

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
    """Key and the value in each recording of every setting that is not the same in all."""
    found = [flat(recorded_configuration(recording)) for recording in recordings]
    keys = sorted({key for one in found for key in one})
    rows = []
    for key in keys:
        values = [one.get(key, ...) for one in found]
        if any(value != values[0] for value in values):
            rows.append((key, *("–" if value is ... else describe_value(value) for value in values)))
    return rows


def flat(values: Mapping[str, Any]) -> dict[str, Any]:
    """Nested tables as one, by dotted key."""
    return dict(_flat("", values, 0))


def describe_value(value: object) -> str:
    """A value in a line."""
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]} … ({len(text)} letters)"


def _flat(before: str, values: Mapping[str, Any], depth: int) -> Iterator[tuple[str, Any]]:
    for key, value in values.items():
        name = f"{before}.{key}" if before else str(key)
        if isinstance(value, dict) and value and depth < _DEEPEST:
            yield from _flat(name, value, depth + 1)
        else:
            yield name, value


def _defaults(recorded: Mapping[str, Any]) -> Mapping[str, Any]:
    """The defaults of a configuration with the same devices; of the usual ones where that cannot be made."""
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
