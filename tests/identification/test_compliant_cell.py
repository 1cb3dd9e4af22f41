"""Identification of a cell whose arm yields: its reported poses show the series stiffness only."""

import math
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.signal import lsim

from hil_bridge.lab.fidelity.measures import Floats
from hil_bridge.lab.fidelity.tables import Table
from hil_bridge.lab.identification.identifying import Identified, identify_run
from hil_bridge.lab.identification.observations import observe_table
from hil_bridge.lab.identification.profile import profile_text
from hil_bridge.lab.identification.surface import surface_values
from hil_bridge.lab.identification.values import Value, Why
from hil_bridge.settings.configuration import load_config
from tests.recordings import Recordings

SURFACE_N_M, ARM_N_M, SENSOR_N_M = 8e3, 8e3, 1.8e7
SERIES_N_M = 1.0 / (1.0 / SURFACE_N_M + 1.0 / ARM_N_M + 1.0 / SENSOR_N_M)
SITE: dict[str, Any] = {
    "run": {"duration_s": 6.0, "seed": 3},
    "robot": {"emulated": "s3"},
    "sensor": {"emulated": "jr3"},
    "cell": {
        "surface": {"stiffness_n_m": SURFACE_N_M},
        "arm": {"compliance": "cartesian", "stiffness_n_m": [ARM_N_M] * 3 + [0.0] * 3},
        "jr3": {"sensor": {"stiffness_n_m": [9.1e6, 9.1e6, SENSOR_N_M]}},
    },
}
FREE_HZ, DAMPING_RATIO = 17.0, 0.03


@pytest.fixture(scope="module")
def identified(recordings: Recordings) -> Identified:
    return identify_run(recordings(SITE))


@pytest.fixture(scope="module")
def profile(identified: Identified, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("twin") / "profile.toml"
    file.write_text(profile_text(identified, "site.mcap"), encoding="utf-8")
    return file


def value_of(identified: Identified, key: str) -> Value:
    value = identified.values.find(key)
    assert value is not None
    return value


def test_stiffness_is_that_of_surface_and_arm_in_series(identified: Identified) -> None:
    stiffness = value_of(identified, "surface.stiffness")
    assert stiffness.holds(SERIES_N_M)
    assert stiffness.high < 0.6 * SURFACE_N_M
    assert value_of(identified, "surface.alone").why is Why.IN_SERIES


def test_profile_states_rigid_arm_whatever_the_default(profile: Path) -> None:
    text = profile.read_text(encoding="utf-8")
    cell = tomllib.loads(text)["cell"]
    assert cell["arm"] == {"compliance": "rigid"}
    assert cell["surface"]["stiffness_n_m"] == pytest.approx(SERIES_N_M, rel=0.1)
    assert "# The stiffness of the surface contains that of arm, sensor and tool" in text


def test_twin_shows_stiffness_of_the_recording(
    recordings: Recordings, identified: Identified, profile: Path
) -> None:
    twin = value_of(identify_run(recordings(profile)), "surface.stiffness")
    site = value_of(identified, "surface.stiffness")
    assert twin.holds(load_config(profile, {}).cell.surface.stiffness_n_m)
    assert max(twin.low, site.low) < SERIES_N_M < min(twin.high, site.high)


def values_of(times: Floats, depth: Floats, press: Floats) -> dict[str, Value]:
    observations = observe_table(Table(times, {"depth": depth, "press": press}))
    return {value.key: value for value in surface_values(observations)}


def _pressed(numerator: list[float], denominator: list[float]) -> dict[str, Value]:
    """Return the values of a contact whose force is this transfer function of the depth, while the loop oscillates at
    20 Hz by 0.1 mm.
    """
    times = np.arange(0.0, 8.0, 0.004)
    depth = np.interp(times, [0.0, 1.0, 2.0], [0.0, 0.0, 2e-3]) + np.where(
        times > 2.0, 3e-4 * np.sin(3.0 * times - 6.0) + 1e-4 * np.sin(40.0 * math.pi * (times - 2.0)), 0.0
    )
    _, press, _ = lsim((numerator, denominator), depth, times)
    press += np.random.default_rng(7).normal(0.0, 0.02, len(times))
    return values_of(times, depth, press)


def test_oscillating_arm_biases_neither_stiffness_nor_damping() -> None:
    omega = 2.0 * math.pi * FREE_HZ
    mass, damper = ARM_N_M / omega**2, 2.0 * DAMPING_RATIO * ARM_N_M / omega
    numerator = [SURFACE_N_M * damper, SURFACE_N_M * ARM_N_M]
    values = _pressed(numerator, [mass, damper, ARM_N_M + SURFACE_N_M])
    stiffness, series = values["surface.stiffness"], 1.0 / (1.0 / SURFACE_N_M + 1.0 / ARM_N_M)
    assert stiffness.holds(series)
    assert stiffness.high - stiffness.low < 0.08 * series
    assert values["surface.damping"].why is Why.BEHIND_DELAY


def test_damper_is_identified_while_the_loop_oscillates() -> None:
    damper = 0.06 * SURFACE_N_M
    values = _pressed([damper, SURFACE_N_M], [1e-3, 1.0])
    assert values["surface.damping"].holds(damper)


def test_depth_noise_does_not_soften_a_short_contact() -> None:
    """The contact lasts 0.24 s, so it cannot be averaged."""
    times = np.arange(0.0, 0.5, 0.004)
    depth = np.maximum(1e-3 * np.sin(2.0 * math.pi * (times - 0.13) / 0.48), -1e-4)
    errors = []
    for seed in range(20):
        noisy = depth + 1.5e-4 * np.random.default_rng(seed).standard_normal(len(times))
        stiffness = values_of(times, noisy, SERIES_N_M * np.maximum(depth, 0.0))["surface.stiffness"]
        errors.append(stiffness.value / SERIES_N_M - 1.0)
    assert abs(np.mean(errors)) < 0.06
