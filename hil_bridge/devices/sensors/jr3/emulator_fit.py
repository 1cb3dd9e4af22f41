"""Settings with which the emulated JR3 has the noise of a measured sensor."""

import math
from typing import Any

from hil_bridge.devices.emulator_fit import Sections, SensorFigures, behind_filter


def match_gateway(settings: Any, figures: SensorFigures) -> Sections:
    """Return the noise for a sensor behind the filter of the CAN gateway; see `hil_bridge.devices.emulator_fit`."""
    return _match(settings.client.gateway, figures)


def match_uart(settings: Any, figures: SensorFigures) -> Sections:
    """Return the noise for a sensor behind the filter of the UART gateway."""
    return _match(settings.client.uart, figures)


def _match(client: Any, figures: SensorFigures) -> Sections:
    """Return the noise before the gateway's filter, in counts, averaged over the axes with a known noise."""
    counts = [noise / scale for noise, scale in zip(figures.noise, figures.scales, strict=True)]
    known = [value for value in counts if math.isfinite(value)]
    if not known:
        return {}
    reduction = 1.0
    if client.cutoff_hz:
        weight = -math.expm1(-2.0 * math.pi * client.cutoff_hz * client.sample_period_us * 1e-6)
        reduction = behind_filter(weight)
    noise = math.sqrt(sum(value**2 for value in known) / len(known)) / reduction
    return {"cell.jr3.sensor": {"noise_counts": round(noise, 3)}}
