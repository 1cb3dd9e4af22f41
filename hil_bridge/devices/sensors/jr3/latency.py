"""Settings of the emulated JR3 gateway for the measured latency of a site."""

from collections.abc import Callable, Sequence

from hil_bridge.devices.emulator_fit import LateSettings

_GATEWAYS = {"jr3": "cell.jr3.gateway", "jr3-uart": "cell.jr3.uart"}
"""Sections of the emulated gateways, by kind of sensor. A board is not included, because its samples arrive when
they are read.
"""
NOT_EMULATED = "the delay of a receiver board's samples is not emulated"


def late_settings(sensor: str, quantiles_ms: Callable[[], Sequence[float]]) -> LateSettings:
    """Return the settings of a sensor with this delay of its frames. The quantiles are computed only if they are
    needed.

    `sensor` is the kind of receiver, as in `sensor.emulated`.
    """
    sections: dict[str, dict[str, object]] = {}
    if sensor != "jr3":
        sections["sensor"] = {"emulated": sensor}
    if sensor not in _GATEWAYS:
        return LateSettings((f"{NOT_EMULATED}.",), sections, NOT_EMULATED)
    sections[_GATEWAYS[sensor]] = {"delay_ms": [*quantiles_ms()]}
    return LateSettings(("the delay of the sensor's frames is relative to the smallest one.",), sections)
