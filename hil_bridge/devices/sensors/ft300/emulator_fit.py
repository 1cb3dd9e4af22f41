"""Settings with which the emulated sensor has the noise of a measured sensor."""

from typing import Any

from hil_bridge.devices.emulator_fit import Sections, SensorFigures, given, known


def match(settings: Any, figures: SensorFigures) -> Sections:
    """Return noise and drift; see `hil_bridge.devices.emulator_fit`."""
    return {
        "cell.ft300": given(
            noise_n=known(figures.noise[:3]),
            noise_nm=known(figures.noise[3:]),
            slope_n_min=known(figures.drift_n_min),
        )
    }
