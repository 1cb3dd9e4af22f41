"""Runs that begin just above the surface: at the defaults, most of a run is the power-up, the way there and back."""

from collections.abc import Mapping
from typing import Any

from hil_bridge.settings.configuration import Config, read_config

STILL: dict[str, Any] = {"wander_n": 0.0, "creep_share": 0.0, "vibration_n": 0.0, "motion_n": 0.0}
"""A Net F/T with white noise alone: a tool that stands off reads 0.0 N. The other errors have tests of their own."""
AWAKE: dict[str, Any] = {
    "netft": {"boot_s": 0.2, **STILL},
    "jr3": {"gateway": {"boot_s": 0.2}, "uart": {"boot_s": 0.2}},
}
"""Sensors of an emulated cell that answer soon after power-up. The tests of each sensor hold its own time."""

NEAR_START: dict[str, Any] = {
    "cell": {"start_position_mm": (900.0, -100.0, 592.0)},
    "task": {"retract_mm": 4.0},
}
"""Settings for a start 2 mm above a flat surface, and a short way back, with the usual power-up of each sensor."""
NEAR: dict[str, Any] = {**NEAR_START, "cell": {**NEAR_START["cell"], **AWAKE}}
"""The same with sensors that answer soon."""


AWAKE_TOML = """\
cell.netft.boot_s = 0.2
cell.netft.wander_n = 0.0
cell.netft.creep_share = 0.0
cell.netft.vibration_n = 0.0
cell.netft.motion_n = 0.0
cell.jr3.gateway.boot_s = 0.2
cell.jr3.uart.boot_s = 0.2
"""
"""AWAKE for the head of a configuration file, before its first section."""

NEAR_TOML = "cell.start_position_mm = [900.0, -100.0, 592.0]\ntask.retract_mm = 4.0\n"
"""The start and the way back of NEAR for the same place."""


def merged(settings: Mapping[str, Any], more: Mapping[str, Any]) -> dict[str, Any]:
    """Nested settings, with more of them laid over."""
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
"""A start 0.5 mm above a flat surface, a quick way back, and little patience with a robot that cannot go it: for tests
about what happens on the surface, and how a run is told.
"""
CLOSE_TOML = """\
sensor.jr3.board.poll_s = 0.05
cell.jr3.board.offsets_zeroed_s = 0.2
cell.start_position_mm = [900.0, -100.0, 590.5]
task.retract_mm = 2.0
task.retract_speed_mm_s = 20.0
limits.retract_patience_s = 0.5
"""
"""The settings of CLOSE that AWAKE lacks, for the head of a configuration file, behind AWAKE_TOML."""
STREAMED: dict[str, Any] = merged(CLOSE, {"run": {"period_ms": 20.0}, "controller": {"sample_ms": 20.0}})
"""The same for a robot that is guided: it is told a set point every 20 ms."""

SHORT: dict[str, Any] = merged(CLOSE, {"run": {"duration_s": 0.5}})
"""A short run that has all phases, for tests that want just any run or recording."""
WHOLE: dict[str, Any] = merged(CLOSE, {"run": {"duration_s": 3.0}})
"""A run that comes to a steady force, for tests that read its figures, charts and tables."""
EMERGENCY_STOP: dict[str, Any] = {"on": "robot", "fault": "emergency-stop", "phase": "track", "after_s": 1.0}
"""A fault that ends it in the middle."""


def awake_config(values: dict[str, Any]) -> Config:
    """Read a configuration with sensors that answer soon after power-up, unless the values say otherwise."""
    return read_config(merged({"cell": AWAKE}, values))
