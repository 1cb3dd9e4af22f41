"""Configuration of an emulated cell that reproduces the behaviour of a recording."""

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from hil_bridge.devices.emulator_fit import RobotFigures, Sections, SensorFigures
from hil_bridge.devices.facts import Pacing
from hil_bridge.errors import ConfigError
from hil_bridge.lab.identification.identifying import Identified
from hil_bridge.lab.identification.line import FRAMES_LOST, PACKETS_LOST
from hil_bridge.lab.identification.motion import NOISE_RATIO, SERVO
from hil_bridge.lab.identification.observations import Contact
from hil_bridge.lab.identification.stream import CUTOFF, DRIFT, NOISE, PERIOD
from hil_bridge.lab.identification.surface import DAMPING, EXPONENT, FRICTION, STIFFNESS
from hil_bridge.lab.identification.text import describe
from hil_bridge.lab.tuning.writing import absolute_files, toml
from hil_bridge.record.analysis.site_latency import robot_quantiles_ms
from hil_bridge.settings.devices import robot_in, sensor_in
from hil_bridge.settings.overrides import lay_over

_DRIFTS = 2.0
"""Smallest drift that is set, in half widths of its interval. Chosen: a smaller drift may be zero."""
_LEVEL_DEG = 0.3
"""Slope below which a path counts as level, °. Chosen."""
_DOWN = 0.999
"""Smallest downward component of the approach at which the surface of an emulated cell can lie below the tool.
Chosen.
"""
_SHARE = 0.1
"""Share of the contact, from its beginning, that determines the height of the surface. Chosen."""
_SERIES = "The stiffness of the surface contains that of arm, sensor and tool; the emulated ones are rigid."
"""Comment of a configuration with an identified stiffness."""
_MM = 1e3


def profile_text(identified: Identified, source: str) -> str:
    """Format the configuration as TOML, with the identified values as comments. `source` is the name of the
    recording.
    """
    config = identified.config
    values: dict[str, Any] = config.model_dump(mode="json", exclude_defaults=True, exclude_none=True)
    for section in ("cell", "faults"):
        values.pop(section, None)
    for name, device in (("robot", robot_in(config)), ("sensor", sensor_in(config))):
        table = values.setdefault(name, {})
        table.pop("url", None)
        table["emulated"] = device.kind.name
    absolute_files(values)
    for sections in (_robot(identified), _sensor(identified), _cell(identified)):
        lay_over(
            values, {f"{name}.{key}": value for name, rows in sections.items() for key, value in rows.items()}
        )
    if faults := list(_faults(identified)):
        values = {"faults": faults, **values}
    notes = [
        f"Identified from {source}; one value and its 95 % interval per line.",
        *(f"  {line}" for line in describe(identified.values, methods=False)),
    ]
    if "arm" in values.get("cell", {}):
        notes.append(_SERIES)
    return toml(values, notes)


def _robot(identified: Identified) -> Sections:
    device, values = robot_in(identified.config), identified.values
    if (
        device.kind.emulation is None
        or device.kind.emulation.match is None
        or not _named(identified, "robot")
    ):
        return {}
    quantiles: Mapping[str, list[float]] = {}
    if identified.run is not None:
        try:
            quantiles = robot_quantiles_ms(identified.run)
        except ConfigError:  # the recording is too short, or has no delays of the robot itself
            quantiles = {}
    figures = RobotFigures(values.get(SERVO.key), values.get(NOISE_RATIO.key), quantiles)
    return device.kind.emulation.match(device.settings, figures)


def _named(identified: Identified, device: str) -> bool:
    """Return whether the kind of a device is known. For a table, it is known only if the configuration names it."""
    return identified.run is not None or device in identified.config.model_fields_set


def _sensor(identified: Identified) -> Sections:
    device, values = sensor_in(identified.config), identified.values
    if (
        device.kind.emulation is None
        or device.kind.emulation.match is None
        or not _named(identified, "sensor")
    ):
        return {}
    x, y, z, u, v, w = (values.get(quantity.key) for quantity in NOISE)
    facts = None if identified.seen.stream is None else identified.seen.stream.facts
    drift = [values.find(quantity.key) for quantity in DRIFT]
    certain = [
        0.0 if one is None or not abs(one.value) > _DRIFTS * 0.5 * (one.high - one.low) else one.value
        for one in drift
    ]
    figures = SensorFigures(
        (x, y, z, u, v, w),
        values.get(CUTOFF.key),
        (certain[0], certain[1], certain[2]) if any(certain) else (math.nan,) * 3,
        values.get(PERIOD.key),
    )
    if facts is not None:
        figures = figures._replace(scales=facts.scales)
    return device.kind.emulation.match(device.settings, figures)


def _cell(identified: Identified) -> Sections:
    """Return the surface, the start pose, the arm and the tool of the emulated cell."""
    config, observations, values = identified.config, identified.seen, identified.values
    surface: dict[str, Any] = {}
    stiffness = values.get(STIFFNESS.key)
    if math.isfinite(stiffness) and stiffness > 0.0:
        surface["stiffness_n_m"] = _rounded(stiffness)
        if observations.contact is not None and observations.cycles:
            surface |= _surface_position(observations.contact, stiffness)
    for quantity, name in ((DAMPING, "damping_ns_m"), (FRICTION, "friction")):
        if math.isfinite(value := values.get(quantity.key)):
            full = _full_friction(identified) if quantity is FRICTION else 1.0
            surface[name] = _rounded(max(value, 0.0) * full)
    tables: dict[str, dict[str, Any]] = {"cell.surface": surface} if surface else {}
    if "stiffness_n_m" in surface:  # an emulated arm, sensor or tool would be in series a second time
        tables["cell.arm"] = {"compliance": "rigid"}
    exponent = values.find(EXPONENT.key)
    if (
        exponent is not None
        and exponent.seen
        and exponent.low > 1.0
        and observations.contact is not None
        and stiffness > 0.0
    ):
        depth = float(np.mean(observations.contact.press)) / stiffness
        tables["cell.surface.material"] = {
            "kind": "hunt_crossley",
            "exponent": _rounded(exponent.value),
            "reference_depth_mm": _rounded(depth * _MM),
        }
    if observations.cycles:
        first = observations.cycles[0].sample
        tables["cell"] = {
            "start_position_mm": [round(part * _MM, 4) for part in first.position],
            "start_quaternion": [round(part, 9) for part in first.quaternion],
        }
    if config.tool.mass_kg:
        tables["cell.tool"] = {
            "mass_kg": config.tool.mass_kg,
            "centre_of_gravity_mm": list(config.tool.centre_of_gravity_mm),
        }
    return tables


def _full_friction(identified: Identified) -> float:
    """Return the ratio of the emulated surface's friction coefficient to its friction at the speed of the run.

    The ratio is 1 for a robot that moves in steps, because each step is fast.
    """
    config = identified.config
    if identified.seen.robot.pacing is Pacing.ASKED or not config.task.speed_mm_s:
        return 1.0
    return (
        math.hypot(config.task.speed_mm_s, config.cell.surface.friction_smoothing_mm_s)
        / config.task.speed_mm_s
    )


def _surface_position(contact: Contact, stiffness: float) -> dict[str, Any]:
    """Return the settings for the position of the surface below the tool, either level or rising along the path.

    Empty if the approach is not downward.
    """
    if -contact.approach[2] < _DOWN or not np.isfinite(contact.place).all():
        return {}
    heights = contact.place[:, 2] + contact.press / stiffness
    begin, end = contact.place[0], contact.place[-1]
    step = (end - begin)[:2]
    length = float(np.linalg.norm(step))
    first = max(1, int(_SHARE * len(heights)))
    table: dict[str, Any] = {
        "origin_x_mm": round(float(begin[0]) * _MM, 3),
        "origin_y_mm": round(float(begin[1]) * _MM, 3),
        "height_mm": round(float(heights[:first].mean()) * _MM, 3),
    }
    if length * _MM < 1.0:
        return table
    along = (contact.place[:, :2] - begin[:2]) @ (step / length)
    rise, level = np.polyfit(along, heights, 1)
    slope = math.degrees(math.atan(float(rise)))
    table["path_deg"] = round(math.degrees(math.atan2(float(step[1]), float(step[0]))), 3)
    if abs(slope) > _LEVEL_DEG:
        table |= {"kind": "sloped", "slope_deg": round(slope, 3), "height_mm": round(float(level) * _MM, 3)}
    return table


def _faults(identified: Identified) -> Iterator[dict[str, Any]]:
    """Yield the losses on both links, as faults that are active from the start."""
    values, emulation = identified.values, sensor_in(identified.config).kind.emulation
    share = values.get(FRAMES_LOST.key) * 1e-3
    if share > 0.0 and emulation is not None:
        yield _lost("sensor-wire", 1.0 - (1.0 - share) ** (1.0 / emulation.packets_per_frame))
    share = values.get(PACKETS_LOST.key) * 1e-3
    if share > 0.0:
        yield _lost("wire", share)


def _lost(on: str, probability: float) -> dict[str, Any]:
    return {
        "on": on,
        "fault": "lost",
        "phase": "connect",
        "with": {"probability": _rounded(min(probability, 1.0)), "way": "from"},
    }


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")
