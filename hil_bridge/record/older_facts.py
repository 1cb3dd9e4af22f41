"""Facts of the devices in recordings of versions 0.1 and 0.2, which knew one robot and one make of sensor.

Version 0.1 told none: they follow from the configuration, what was checked before the touch, and the end. Version 0.2
told some under other names. The facts of the S3 and the JR3 of that time stand here once more as plain numbers. So
these recordings mean the same, whatever becomes of the devices.
"""

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

import msgspec

from hil_bridge.devices.facts import (
    ACCEPTED,
    Devices,
    Hop,
    Moment,
    Owner,
    RobotFacts,
    RobotHops,
    Sensor,
    ServoFacts,
)
from hil_bridge.errors.text_files import parse_json
from protocol.wrench import AXES, SensorFacts

_COUNTS = 16384
"""Counts of full scale; twice as many can be told. Source: JR3 manual 5907E."""
_STATUS_ANSWER, _MOVE_ANSWER = 41, 17
"""Characters of both answers: a header of 8, a status of 24, and 9 around a telegram.

Source: computer-link specification, sections 2 and 5.
"""
_CYCLE = 84
"""Characters of a cycle beside its move telegram: three other telegrams of 8, 32 and 8, and 9 around each of four."""
_FULL_SCALES = re.compile(r"full scales ((?:[0-9.]+ ){6})N, N·m")

_TURNAROUND = Hop("turnaround", "transmitted_at", ACCEPTED, Owner.ROBOT, "robot's turnaround of the move")
_LINE = Hop("line", "sent_at", "transmitted_at", Owner.LINE, "line time of the move")
_BEHIND = "interpolator and way to the position loops"


def _hops(status_answer_s: float, move_answer_s: float) -> RobotHops:
    """Hops of an S3 whose answers take so long on the line."""
    return RobotHops(
        to_answer=(
            _LINE,
            _TURNAROUND,
            Hop("answer", ACCEPTED, "answered_at", Owner.LINE, "line time of the move's answer"),
        ),
        to_motion=(
            (
                _LINE,
                _TURNAROUND,
                Hop("interpolation", ACCEPTED, "motion_at", Owner.ROBOT, f"robot's queue, {_BEHIND}"),
            ),
            (
                _LINE,
                Hop("robot", "transmitted_at", "motion_at", Owner.ROBOT, f"robot's turnaround, {_BEHIND}"),
            ),
        ),
        beside=(
            Hop(
                "status_line",
                "started_at",
                "status_transmitted_at",
                Owner.LINE,
                "line time of the status order",
            ),
            Hop(
                "status_turnaround",
                "status_transmitted_at",
                "status_replied_at",
                Owner.ROBOT,
                "robot's turnaround of the status order",
            ),
            Hop(
                "status_answer",
                "status_replied_at",
                "status_at",
                Owner.LINE,
                "line time of the status answer",
            ),
        ),
        moments=(
            Moment(ACCEPTED, "answered_at", move_answer_s),
            Moment("status_replied_at", "status_at", status_answer_s),
        ),
    )


def with_present_names(told: Mapping[str, object]) -> dict[str, object]:
    """Facts as parsed JSON by device, those that version 0.2 told under other names renamed."""
    found = dict(told)
    robot, sensor = _table(told, "robot"), _table(told, "sensor")
    answers = _number(robot, "status_answer_s"), _number(robot, "move_answer_s")
    if "hops" not in robot and answers[0] is not None and answers[1] is not None:
        found["robot"] = {**robot, "hops": msgspec.to_builtins(_hops(answers[0], answers[1]))}
    if "facts" not in sensor and "delay_s" in sensor:
        facts = {
            "model": sensor.get("model", ""),
            "scales": sensor.get("scales"),
            "full_scales": sensor.get("full_scales"),
            "range": None,
            "period": sensor.get("period_s"),
            "delay": sensor.get("delay_s"),
            "tares": "device",
        }
        found["sensor"] = {"kind": sensor.get("kind", ""), "facts": facts}
    return found


def from_configuration(config: Mapping[str, Any], end: Mapping[str, str], checks: Sequence[str]) -> Devices:
    """Facts of a recording that tells none: from its configuration, its end, and what was checked before the touch."""
    cell, robot = _table(config, "cell"), _table(config, "robot")
    servo = _table(cell, "servo")
    step = _number(servo, "resolution_mm")
    link = _table(robot, "link")
    facts = RobotFacts(
        emulated=robot.get("url") == "",
        position_step_m=step * 1e-3 if step else None,
        servo=_servo(servo),
    )
    try:
        character, told = _character_time(link), _told_number(end, "line_floor_s")
    except ValueError:
        return Devices(facts, _sensor(config, end, checks))
    floor = (_CYCLE + (_number(link, "move_length") or _MOVE_LENGTH)) * character
    ratio = told / floor if told else 1.0  # a URL may have set another line
    facts = msgspec.structs.replace(
        facts,
        kind="s3",
        line_floor_s=floor * ratio,
        hops=_hops(_STATUS_ANSWER * character * ratio, _MOVE_ANSWER * character * ratio),
    )
    return Devices(facts, _sensor(config, end, checks))


_MOVE_LENGTH = 52
"""Bytes of a move telegram where the configuration does not tell. Source: as above."""


def _character_time(link: Mapping[str, Any]) -> float:
    """Time of one character on the line, s. Raises ValueError for invalid settings."""
    baudrate, parity, stop_bits = _number(link, "baudrate"), link.get("parity", "E"), link.get("stop_bits", 1)
    if not baudrate or parity not in ("N", "E", "O") or stop_bits not in (1, 2):
        raise ValueError("no settings of a serial line")
    return float((1 + 8 + (parity != "N") + stop_bits) / baudrate)


def _servo(servo: Mapping[str, Any]) -> ServoFacts | None:
    names = ("interpolation_ms", "transport_delay_ms", "natural_frequency_rad_s", "damping_ratio")
    interpolation, transport, frequency, damping = (_number(servo, name) for name in names)
    if not (interpolation and transport is not None and frequency and damping):
        return None
    dead_band = _number(servo, "dead_band_steps") or 0.0
    return ServoFacts(interpolation * 1e-3, transport * 1e-3, frequency, damping, dead_band)


def _sensor(config: Mapping[str, Any], end: Mapping[str, str], checks: Sequence[str]) -> Sensor:
    sensor = _table(config, "sensor")
    try:
        delay = _told_number(end, "sensor_delay_s")
    except ValueError:
        delay = None
    if delay is None:
        delay = _gateway_delay(sensor)  # it was cut off before its end
    scales = _full_scales(config, checks)
    if scales is None or delay is None:
        return Sensor(older_delay_s=delay)
    a, b, c, d, e, f = (scale / _COUNTS for scale in scales)
    return Sensor(facts=SensorFacts("", (a, b, c, d, e, f), None, None, None, delay, "device"))


def _full_scales(config: Mapping[str, Any], checks: Sequence[str]) -> list[float] | None:
    """Full scales of the sensor, as told before the touch, else those of the emulated one, N and N·m."""
    for text in checks:
        if found := _FULL_SCALES.match(text):
            told: list[Any] = found[1].split()
            break
    else:
        cell, sensor = _table(config, "cell"), _table(config, "sensor")
        emulated = _table(cell, "sensor") if sensor.get("url") == "" else {}
        told = [*_list(emulated, "full_scales_n"), *_list(emulated, "full_scales_nm")]
    try:
        scales = [float(one) for one in told]
    except (TypeError, ValueError):
        return None
    known = len(scales) == len(AXES) and all(0.0 < scale < math.inf for scale in scales)
    return scales if known else None


def _gateway_delay(sensor: Mapping[str, Any]) -> float | None:
    """Delay of a CAN gateway's filter; None for other devices, whose URLs only the composition root reads."""
    url = sensor.get("url")
    on_can = (
        url.startswith("can+")
        if isinstance(url, str) and url
        else sensor.get("emulated") in (None, "gateway")
    )
    cutoff = _number(_table(sensor, "gateway"), "cutoff_hz") if on_can else None
    return 1.0 / (math.tau * cutoff) if cutoff else None


def _table(table: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    found = table.get(name)
    return found if isinstance(found, dict) else {}


def _list(table: Mapping[str, Any], name: str) -> list[Any]:
    found = table.get(name)
    return found if isinstance(found, list) else []


def _number(table: Mapping[str, Any], name: str) -> float | None:
    found = table.get(name)
    if isinstance(found, bool) or not isinstance(found, (int, float)):
        return None
    return float(found) if 0.0 <= found < 1e9 else None


def _told_number(end: Mapping[str, str], name: str) -> float | None:
    """Number in the end's metadata under this name, if it is one. Raises ValueError for a text that is no JSON."""
    return _number({name: parse_json(end.get(name, "null"))}, name)
