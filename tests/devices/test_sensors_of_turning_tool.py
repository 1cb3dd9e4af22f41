"""Unbalance of a turning tool through each sensor, its wire and its client: only the sensor's filter attenuates it."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from emulators.tool import ToolProfile
from hil_bridge.devices.kinds import SENSORS, KindSettings, default_settings
from hil_bridge.testing import SensorCase
from hil_bridge.testing.sensor_rig import SensorRig, run_sensor
from protocol.wrench import wrench_of
from tests.emulation.quiet_sensor import SETTLED
from tests.paper_cell import PaperCellProfile, s3_jr3_cell

FORCE_N = 5.0


def settings_of(kind: str, client: dict[str, Any], emulated: dict[str, Any]) -> KindSettings[Any, Any]:
    """Return settings of a sensor without errors except white noise, changed by those of client and emulator."""
    usual = default_settings(SENSORS.kind(kind))
    if not kind.startswith("jr3"):
        return replace(usual, emulated=replace(usual.emulated, **SETTLED, **emulated))
    parts = {name: replace(getattr(usual.client, name), **values) for name, values in client.items()}
    return replace(usual, client=replace(usual.client, **parts))


def one_pole(hertz: float, cutoff_hz: float, rate_hz: float) -> float:
    """Return the gain of a sampled one-pole filter whose weight is that of a backward difference."""
    weight = 1.0 / (1.0 + rate_hz / (math.tau * cutoff_hz))
    return weight / abs(1.0 - (1.0 - weight) * np.exp(-1j * math.tau * hertz / rate_hz))


HALF_POWER_HZ = 31.262
"""Frequency at which filter 3 of the board has a gain of −3.01 dB. Source: plots of the manual 5907E."""
CASES: dict[str, tuple[dict[str, Any], dict[str, Any], float, float]] = {
    "jr3": ({"gateway": {"cutoff_hz": 12.0}}, {}, 30.0, one_pole(30.0, 12.0, 1e6 / 128.5)),
    "jr3-uart": ({"uart": {"cutoff_hz": 12.0}}, {}, 30.0, one_pole(30.0, 12.0, 1e6 / 128.5)),
    "jr3-board": ({"board": {"filter": 3}}, {}, HALF_POWER_HZ, math.sqrt(0.5)),
    "netft": ({}, {"filter": 6}, 30.0, 18.0 / math.hypot(30.0, 18.0)),
    "ft300": ({}, {}, 30.0, 1.0),
    "ft300-urcap": ({}, {}, 30.0, 1.0),
    "ati-can": ({}, {}, 30.0, 1.0),
}
"""By kind of sensor: settings of client and emulator, turns per second, and gain of its filter at them."""


@pytest.mark.parametrize("kind", CASES)
def test_filter_of_sensor_attenuates_unbalance(kind: str) -> None:
    client, emulated, hertz, gain = CASES[kind]
    unbalance_g_mm = FORCE_N / (hertz * math.tau) ** 2 * 1e6
    tool = ToolProfile(mass_kg=0.0, spindle_rpm=60.0 * hertz, unbalance_g_mm=unbalance_g_mm)

    async def check(rig: SensorRig) -> None:
        rig.source.wrench = s3_jr3_cell(PaperCellProfile(tool=tool), rig.clock.now(), 1).wrench
        async with rig.started() as sensor:
            await rig.wait(1.0)
            rig.frames.clear()
            await rig.wait(2.0)
            sampled = [rig.sensor.sampled_at(frame.counter) for frame in rig.frames]
            times = np.array(
                [frame.at if at is None else at for at, frame in zip(sampled, rig.frames, strict=True)]
            )
            forces = np.array([wrench_of(frame.values, sensor.facts.scales) for frame in rig.frames])[:, :2]
        angles = math.tau * hertz * (times - times[0])
        base = np.column_stack((np.cos(angles), np.sin(angles), np.ones_like(angles)))
        fitted = np.linalg.lstsq(base, forces, rcond=None)[0]
        assert np.hypot(*fitted[:2]) == pytest.approx([gain * FORCE_N] * 2, rel=0.01)

    run_sensor(SensorCase(SENSORS.kind(kind), settings=settings_of(kind, client, emulated)), check)
