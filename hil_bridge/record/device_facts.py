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


def device_urls(recording: Recording) -> tuple[str, str] | None:
    """Return the URLs of robot and sensor; the URL of an emulated device is empty."""
    recorded: Any = recorded_configuration(recording)
    robot, sensor = recorded.get("robot"), recorded.get("sensor")
    if not isinstance(robot, dict) or not isinstance(sensor, dict) or "url" not in robot:
        return None
    return str(robot.get("url") or ""), str(sensor.get("url") or "")


def is_beyond_run(recording: Recording) -> bool:
    """Return whether robot and sensor outlive the run, so that a tool can still be moved. Devices that the run emulates
    end with it; devices of an unknown kind count as real.
    """
    urls = device_urls(recording)
    return urls is None or all(urls)


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
