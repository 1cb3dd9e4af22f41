"""Facts about the devices of a run, as its recording tells them: what a report needs to know of robot and sensor."""

import math
from collections.abc import Mapping
from typing import Annotated, Any, TypeAlias, TypeVar

import msgspec
from msgspec import Meta, Struct

from hil_bridge.recording.reader import Recording
from hil_bridge.text_files import parse_json
from protocol.s3.adlp import LinkProfile
from protocol.s3.timing import answer_time, line_floor, move_answer_time

_Facts = TypeVar("_Facts", bound=Struct)
_Positive: TypeAlias = Annotated[float, Meta(gt=0.0)]
_NotNegative: TypeAlias = Annotated[float, Meta(ge=0.0)]


class ServoFacts(Struct, frozen=True):
    """How the robot follows its points."""

    interpolation_s: _Positive
    """Between two set points of the interpolator."""
    transport_delay_s: _NotNegative
    natural_frequency_rad_s: _Positive
    damping_ratio: _Positive
    dead_band_steps: _NotNegative = 0.0
    """How far the position may be off without being corrected, either way, in steps of the position."""
    marks: dict[str, str] = {}
    """How well each of them is known, see `protocol.marks`, by the name of its setting."""


class RobotFacts(Struct, frozen=True):
    """What is known of the robot."""

    kind: str = "s3"
    emulated: bool = False
    position_step_m: _Positive | None = None
    """Resolution of the position; None where it is not known."""
    line_floor_s: _Positive | None = None
    """What the characters of one cycle take on the line at least."""
    status_answer_s: _NotNegative | None = None
    """What the characters of a status answer take on the line."""
    move_answer_s: _NotNegative | None = None
    """The same of a move's answer."""
    servo: ServoFacts | None = None


class SensorFacts(Struct, frozen=True):
    """What is known of the sensor and of what stands before it."""

    kind: str = ""
    """gateway, uart or board; empty where it is not known."""
    model: str = ""
    """As the device says; empty where it says nothing."""
    full_scales: tuple[float, ...] = ()
    """fx fy fz mx my mz, N and N·m."""
    scales: tuple[float, ...] = ()
    """N and N·m per count, in the same order."""
    delay_s: _NotNegative | None = None
    """How much later than the force itself its filter tells of it, at low frequencies."""
    period_s: _NotNegative | None = None
    """Between two frames; None where they come only when asked for."""


class Devices(Struct, frozen=True):
    """Robot and sensor of a run."""

    robot: RobotFacts = RobotFacts()
    sensor: SensorFacts = SensorFacts()

    def as_metadata(self) -> dict[str, str]:
        """For a recording: JSON by device."""
        return {name: msgspec.json.encode(getattr(self, name)).decode() for name in self.__struct_fields__}


def robot_facts(
    servo: Mapping[str, Any],
    link: LinkProfile | None,
    emulated: bool,
    floor_s: float | None = None,
    marks: Mapping[str, str] | None = None,
) -> RobotFacts:
    """From the settings of the servo and the profile of the link.

    `floor_s` is the line's floor where a URL set the line; `marks` are those of the settings by name.
    """
    names = ("interpolation_ms", "transport_delay_ms", "natural_frequency_rad_s", "damping_ratio")
    interpolation, transport, frequency, damping = (_number(servo, name) for name in names)
    known = None
    if interpolation and transport is not None and frequency and damping:
        dead_band = _number(servo, "dead_band_steps") or 0.0
        known = ServoFacts(
            interpolation * 1e-3, transport * 1e-3, frequency, damping, dead_band, dict(marks or {})
        )
    step = _number(servo, "resolution_mm")
    facts = RobotFacts(emulated=emulated, position_step_m=step * 1e-3 if step else None, servo=known)
    if link is None:
        return facts
    ratio = 1.0 if floor_s is None else floor_s / line_floor(link)
    return msgspec.structs.replace(
        facts,
        line_floor_s=line_floor(link) * ratio,
        status_answer_s=answer_time(link) * ratio,
        move_answer_s=move_answer_time(link) * ratio,
    )


def devices_of(recording: Recording) -> Devices:
    """What a recording tells of its devices; one that was made before recordings told them is asked for its
    configuration and its end.
    """
    if not recording.devices:
        return _older(recording)
    told = recording.devices
    return Devices(_told(told.get("robot"), RobotFacts), _told(told.get("sensor"), SensorFacts))


def recorded_configuration(recording: Recording) -> Mapping[str, Any]:
    """The configuration that the run has recorded; empty when there is none that can be read."""
    found = json_or_none(recording.metadata.get("config"))
    return found if isinstance(found, dict) else {}


def json_or_none(text: str | None) -> object:
    """What a text of a recording says; None where it says nothing or is no JSON."""
    try:
        return parse_json(text) if text else None
    except ValueError:
        return None


def _told(text: str | None, kind: type[_Facts]) -> _Facts:
    try:
        return msgspec.json.decode(text or "{}", type=kind)
    except ValueError:
        return kind()


def _older(recording: Recording) -> Devices:
    """Of a recording without facts, as version 0.1.0 left them."""
    config, end = recorded_configuration(recording), recording.end
    robot, cell, sensor = (_table(config, name) for name in ("robot", "cell", "sensor"))
    try:
        link = LinkProfile(**robot["link"])
        told = parse_json(end.get("line_floor_s", "null"))
    except (KeyError, TypeError, ValueError):
        link, told = None, None
    floor = float(told) if isinstance(told, (int, float)) and told > 0 else None
    delay = json_or_none(end.get("sensor_delay_s"))
    if isinstance(delay, bool) or not isinstance(delay, (int, float)) or delay < 0.0:
        delay = _gateway_delay(sensor)  # it was cut off before its end
    return Devices(
        robot_facts(_table(cell, "servo"), link, robot.get("url") == "", floor),
        SensorFacts(delay_s=delay),
    )


def _gateway_delay(sensor: Mapping[str, Any]) -> float | None:
    """Of a CAN gateway's filter; None for other devices, whose URLs only the composition root reads."""
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


def _number(table: Mapping[str, Any], name: str) -> float | None:
    found = table.get(name)
    if isinstance(found, bool) or not isinstance(found, (int, float)):
        return None
    return float(found) if 0.0 <= found < 1e9 else None
