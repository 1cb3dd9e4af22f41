"""Settings with which the emulated box has the noise of a measured box."""

import math
from typing import Any

from hil_bridge.devices.emulator_fit import Sections, SensorFigures, behind_filter, given, noise_settings
from protocol.devices.netft.page import FILTERS_HZ, filter_weight


def match(settings: Any, figures: SensorFigures) -> Sections:
    """Return the nearest filter, and the noise before that filter; see `hil_bridge.devices.emulator_fit`."""
    number = 0
    if not math.isnan(figures.cutoff_hz):
        number = min(
            range(1, len(FILTERS_HZ)), key=lambda one: abs(math.log(FILTERS_HZ[one] / figures.cutoff_hz))
        )
    reduction = behind_filter(filter_weight(FILTERS_HZ[number])) if number else 1.0
    rate = None if math.isnan(figures.period_s) else min(max(1, round(1.0 / figures.period_s)), 7000)
    return {
        "cell.netft": given(
            filter=number or None,
            rate_hz=rate,
            **noise_settings(figures, 1.0 / reduction),
        )
    }
