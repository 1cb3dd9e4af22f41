"""A site's measured latency as settings of what stands before the emulated JR3."""

from collections.abc import Callable, Sequence

from hil_bridge.devices.emulator_fit import LateSettings

_GATEWAYS = {"jr3": "cell.jr3.gateway", "jr3-uart": "cell.jr3.uart"}
"""Sections of the emulated gateways, by what stands before the sensor. A board's samples come when they are read."""
NOT_EMULATED = "the delay of a receiver board's samples is not emulated"


def late_settings(sensor: str, quantiles_ms: Callable[[], Sequence[float]]) -> LateSettings:
    """Settings of a sensor whose frames are so late. The quantiles are asked for only where they serve.

    `sensor` is what stands before it, as `sensor.emulated` names it.
    """
    sections: dict[str, dict[str, object]] = {}
    if sensor != "jr3":
        sections["sensor"] = {"emulated": sensor}
    if sensor not in _GATEWAYS:
        return LateSettings((f"{NOT_EMULATED}.",), sections, NOT_EMULATED)
    sections[_GATEWAYS[sensor]] = {"delay_ms": [*quantiles_ms()]}
    return LateSettings(("the delay of the sensor's frames is that above the smallest one.",), sections)
