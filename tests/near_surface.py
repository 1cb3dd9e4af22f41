"""Runs that start just above the surface: with default settings, most of a run is power-up, approach and retraction."""

from collections.abc import Mapping
from typing import Any

from hil_bridge.settings.configuration import Config, read_config

STILL: dict[str, Any] = {"wander_n": 0.0, "creep_share": 0.0, "vibration_n": 0.0, "motion_n": 0.0}
"""Settings of a Net F/T with white noise alone: a lifted tool reads 0.0 N. Other tests cover the other errors."""
AWAKE: dict[str, Any] = {
    "netft": {"boot_s": 0.2, **STILL},
    "jr3": {"gateway": {"boot_s": 0.2}, "uart": {"boot_s": 0.2}},
}
"""Settings of an emulated cell's sensors that answer soon after power-up. The tests of each sensor cover its own time.
"""

NEAR_START: dict[str, Any] = {
    "cell": {"start_position_mm": (900.0, -100.0, 592.0)},
    "task": {"retract_mm": 4.0},
}
"""Settings for a start 2 mm above a flat surface, and a short retraction, with the default power-up of each sensor."""
NEAR: dict[str, Any] = {**NEAR_START, "cell": {**NEAR_START["cell"], **AWAKE}}
"""Settings of NEAR_START with sensors that answer soon."""


AWAKE_TOML = """\
cell.netft.boot_s = 0.2
cell.netft.wander_n = 0.0
cell.netft.creep_share = 0.0
cell.netft.vibration_n = 0.0
cell.netft.motion_n = 0.0
cell.jr3.gateway.boot_s = 0.2
cell.jr3.uart.boot_s = 0.2
"""
"""AWAKE for the top of a configuration file, before its first section."""

NEAR_TOML = "cell.start_position_mm = [900.0, -100.0, 592.0]\ntask.retract_mm = 4.0\n"
"""Start and retraction of NEAR, for the top of a configuration file."""


def merged(settings: Mapping[str, Any], more: Mapping[str, Any]) -> dict[str, Any]:
    """Return nested settings, overridden by others."""
    result = dict(settings)
    for key, value in more.items():
        both = isinstance(value, dict) and isinstance(result.get(key), dict)
        result[key] = merged(result[key], value) if both else value
    return result


CLOSE: dict[str, Any] = merged(
    merged(NEAR, {"sensor": {"jr3": {"board": {"poll_s": 0.05}}}}),
    {
        "cell": {
            "start_position_mm": (900.0, -100.0, 590.5),
            "jr3": {"board": {"offsets_zeroed_s": 0.2}},
        },
        "task": {"retract_mm": 2.0, "retract_speed_mm_s": 20.0},
        "limits": {"retract_patience_s": 0.5},
    },
)
"""Settings for a start 0.5 mm above a flat surface, a fast retraction, and a short wait for a robot that cannot
retract; for tests of what happens on the surface.
"""
CLOSE_TOML = """\
sensor.jr3.board.poll_s = 0.05
cell.jr3.board.offsets_zeroed_s = 0.2
cell.start_position_mm = [900.0, -100.0, 590.5]
task.retract_mm = 2.0
task.retract_speed_mm_s = 20.0
limits.retract_patience_s = 0.5
"""
"""Settings of CLOSE that AWAKE lacks, for the top of a configuration file, after AWAKE_TOML."""
STREAMED: dict[str, Any] = merged(CLOSE, {"run": {"period_ms": 20.0}, "controller": {"sample_ms": 20.0}})
"""Settings of CLOSE for a streamed robot, which receives a set point every 20 ms."""

SHORT: dict[str, Any] = merged(CLOSE, {"run": {"duration_s": 0.5}})
"""Settings of a short run with all phases, for tests that need any run or recording."""
WHOLE: dict[str, Any] = merged(CLOSE, {"run": {"duration_s": 3.0}})
"""Settings of a run that reaches a steady force, for tests that read its figures, charts and tables."""
EMERGENCY_STOP: dict[str, Any] = {"on": "robot", "fault": "emergency-stop", "phase": "track", "after_s": 1.0}
"""Fault that ends it in the middle."""


def awake_config(values: dict[str, Any]) -> Config:
    """Read a configuration with sensors that answer soon after power-up, unless the values override that."""
    return read_config(merged({"cell": AWAKE}, values))
