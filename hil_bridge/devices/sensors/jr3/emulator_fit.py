"""Settings of the emulated JR3 that is as noisy as a measured one."""

import math
from typing import Any

from hil_bridge.devices.emulator_fit import Sections, SensorFigures, behind_filter


def match_gateway(settings: Any, figures: SensorFigures) -> Sections:
    """As `hil_bridge.devices.emulator_fit` says, behind the filter of the CAN gateway."""
    return _match(settings.client.gateway, figures)


def match_uart(settings: Any, figures: SensorFigures) -> Sections:
    """The same of the UART gateway."""
    return _match(settings.client.uart, figures)


def _match(client: Any, figures: SensorFigures) -> Sections:
    """The noise in counts before the gateway's filter, on the mean of the axes whose noise is seen."""
    counts = [noise / scale for noise, scale in zip(figures.noise, figures.scales, strict=True)]
    seen = [value for value in counts if math.isfinite(value)]
    if not seen:
        return {}
    lowered = 1.0
    if client.cutoff_hz:
        weight = -math.expm1(-2.0 * math.pi * client.cutoff_hz * client.sample_period_us * 1e-6)
        lowered = behind_filter(weight)
    noise = math.sqrt(sum(value**2 for value in seen) / len(seen)) / lowered
    return {"cell.jr3.sensor": {"noise_counts": round(noise, 3)}}
