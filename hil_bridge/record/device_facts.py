"""Facts of the devices in a recording."""

from collections.abc import Mapping
from typing import Any, TypeVar

import msgspec
from msgspec import Struct

from hil_bridge.devices.facts import Devices, RobotFacts, Sensor
from hil_bridge.errors.text_files import parse_json
from hil_bridge.record.reader import Recording

_Facts = TypeVar("_Facts", bound=Struct)


def devices_of(recording: Recording) -> Devices:
    """Return the facts of the devices in a recording; empty if the run ended before they were ready."""
    return devices_in(recording.devices)


def devices_in(facts: Mapping[str, str]) -> Devices:
    """Return the facts of devices from JSON by name, as stored in a recording; missing facts get their defaults."""
    values = {name: json_or_none(text) for name, text in facts.items()}
    return Devices(
        _convert_facts(values.get("robot"), RobotFacts), _convert_facts(values.get("sensor"), Sensor)
    )


def recorded_configuration(recording: Recording) -> Mapping[str, Any]:
    """Return the configuration in a recording; empty if it is unreadable."""
    configuration = json_or_none(recording.metadata.get("config"))
    return configuration if isinstance(configuration, dict) else {}


def json_or_none(text: str | None) -> object:
    """Return the value of a JSON text in a recording; None if the text is empty or invalid JSON."""
    try:
        return parse_json(text) if text else None
    except ValueError:
        return None


def _convert_facts(value: object, kind: type[_Facts]) -> _Facts:
    try:
        return msgspec.convert(value, kind)
    except ValueError:
        return kind()
