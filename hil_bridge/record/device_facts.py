"""The facts of a recording's devices, as it tells them."""

from collections.abc import Mapping
from typing import Any, TypeVar

import msgspec
from msgspec import Struct

from hil_bridge.devices.facts import Devices, RobotFacts, Sensor
from hil_bridge.errors.text_files import parse_json
from hil_bridge.record.reader import Recording

_Facts = TypeVar("_Facts", bound=Struct)


def devices_of(recording: Recording) -> Devices:
    """Facts of the devices in a recording; without any where the run ended before they were ready."""
    return devices_in(recording.devices)


def devices_in(facts: Mapping[str, str]) -> Devices:
    """Facts of devices from JSON by name, as a recording keeps them; those that are not told are the defaults."""
    told = {name: json_or_none(text) for name, text in facts.items()}
    return Devices(_told(told.get("robot"), RobotFacts), _told(told.get("sensor"), Sensor))


def recorded_configuration(recording: Recording) -> Mapping[str, Any]:
    """Return the configuration that the run has recorded; empty if none can be read."""
    found = json_or_none(recording.metadata.get("config"))
    return found if isinstance(found, dict) else {}


def json_or_none(text: str | None) -> object:
    """Value of a JSON text in a recording; None where the text is empty or no JSON."""
    try:
        return parse_json(text) if text else None
    except ValueError:
        return None


def _told(told: object, kind: type[_Facts]) -> _Facts:
    try:
        return msgspec.convert(told, kind)
    except ValueError:
        return kind()
