"""A site's measured latency as settings of what stands before the emulated JR3."""

from collections.abc import Callable, Sequence

_GATEWAYS = {"jr3": "cell.jr3.gateway", "jr3-uart": "cell.jr3.uart"}
"""Sections of the emulated gateways, by what stands before the sensor. A board's samples come when they are read."""
NOT_EMULATED = "the delay of a receiver board's samples is not emulated"


def is_emulated(sensor: str) -> bool:
    """Whether the delay of its samples is; `sensor` is what stands before it, as `sensor.emulated` names it."""
    return sensor in _GATEWAYS


def late_settings(
    sensor: str, quantiles_ms: Callable[[], Sequence[float]]
) -> tuple[str, dict[str, dict[str, object]]]:
    """A note for people, and settings by section of a sensor whose frames are so late; asked for where they serve."""
    sections: dict[str, dict[str, object]] = {}
    if sensor != "jr3":
        sections["sensor"] = {"emulated": sensor}
    if not is_emulated(sensor):
        return f"{NOT_EMULATED}.", sections
    sections[_GATEWAYS[sensor]] = {"delay_ms": [*quantiles_ms()]}
    return "the delay of the sensor's frames is that above the smallest one.", sections
