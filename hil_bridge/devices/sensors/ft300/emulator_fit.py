"""Settings of the emulated sensor that is as noisy as a measured one."""

from typing import Any

from hil_bridge.devices.emulator_fit import Sections, SensorFigures, given, known


def match(settings: Any, figures: SensorFigures) -> Sections:
    """As `hil_bridge.devices.emulator_fit` says."""
    return {
        "cell.ft300": given(
            noise_n=known(figures.noise[:3]),
            noise_nm=known(figures.noise[3:]),
            slope_n_min=known(figures.drift_n_min),
        )
    }
