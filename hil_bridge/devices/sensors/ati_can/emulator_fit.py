"""Settings with which the emulated board has the noise of a measured board."""

import math
from typing import Any

from hil_bridge.devices.emulator_fit import Sections, SensorFigures, given, known


def match(settings: Any, figures: SensorFigures) -> Sections:
    """Return the gage noise that causes the mean noise of the axes; see `hil_bridge.devices.emulator_fit`."""
    profile = settings.emulated
    gages = None
    if all(map(math.isfinite, figures.noise)):
        rows = [profile.matrix[6 * axis : 6 * axis + 6] for axis in range(6)]
        each = [
            noise * profile.counts_per_unit / math.hypot(*row)
            for noise, row in zip(figures.noise, rows, strict=True)
        ]
        gages = round(math.sqrt(sum(value**2 for value in each) / len(each)), 3)
    return {"cell.ati_can": given(noise_gages=gages, slope_n_min=known(figures.drift_n_min))}
