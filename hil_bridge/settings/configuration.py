"""Configuration of a run: one validated TOML file, with the unit of every setting in its key."""

import dataclasses
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    PydanticUserError,
    TypeAdapter,
    ValidationError,
    ValidationInfo,
    create_model,
    field_validator,
)
from pydantic_core import InitErrorDetails

from hil_bridge.clock.order import VirtualOrder
from hil_bridge.clock.realtime import RealTime
from hil_bridge.control import Limits, OscillationDetector
from hil_bridge.control.controllers import controller_kind
from hil_bridge.control.course.facing import Contour, Facing
from hil_bridge.control.steps.settings import TaskSettings
from hil_bridge.devices.kinds import (
    ROBOTS,
    SENSORS,
    SURFACES,
    CellSection,
    EmulatedKinds,
    Registry,
    field_name,
)
from hil_bridge.errors import ConfigError, SettingRefused
from hil_bridge.errors.text_files import format_value, read_toml
from hil_bridge.settings.faults import FaultConfig
from hil_bridge.settings.kinds import (
    USUAL_ROBOT,
    USUAL_SENSOR,
    Chosen,
    cell_with,
    chosen_in,
    section_with,
    with_cell_defaults,
)
from hil_bridge.settings.overrides import lay_over
from hil_bridge.settings.places import resolve_files
from hil_bridge.settings.program import (
    STEPS_HINT,
    count_problems,
    describe_problem,
    first_problem,
    instead_of,
    with_program,
)
from hil_bridge.settings.sections import changed_html, is_section, items_of
from protocol.geometry import Quaternion, Vector, normalise
from protocol.marks import SettingError

OPTIONS = {
    "run.duration_s": "--duration",
    "robot.emulated": "--robot",
    "sensor.emulated": "--sensor",
    "cell.surface_kind": "--surface",
    "run.seed": "--seed",
    "run.panel_url": "--panel",
    "robot.url": "--robot",
    "sensor.url": "--sensor",
    "sensor.unchecked": "--unchecked",
    "sensor.unverified": "--unverified",
    "tool.mass_kg": "--tool-mass-kg",
    "controller.name": "--controller",
    "task.force_n": "--force-n",
    "task.file": "--task",
}
"""Command-line options, by the key that they override."""


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    def __repr_args__(self) -> Iterator[tuple[str, Any]]:
        """Return the settings that differ from their defaults."""
        defaults = type(self).model_fields
        return ((name, value) for name, value in items_of(self) if value != defaults[name].default)

    def _repr_html_(self) -> str:
        """Return the settings that differ from their defaults as an HTML table for notebooks."""
        return changed_html(self)


class RunConfig(_Section):
    """Duration, seed, period and panel of the run."""

    duration_s: float = Field(default=30.0, gt=0)
    """Time to track the surface once in contact."""
    seed: int = Field(default=1, ge=0)
    """Seed of every random draw in the emulated cell."""
    period_ms: float = Field(default=0.0, ge=0)
    """Control period; 0 runs as fast as the robot's link answers."""
    panel_url: str = ""
    """URL at which the emulated controller's panel listens, tcp-listen://127.0.0.1:0; empty: no panel."""


class RobotConfig(_Section):
    """The robot controller and its link."""

    url: str = ""
    """KIND+WIRE, such as s3+serial:///dev/ttyUSB0?baudrate=9600&parity=E or egm+udp-bind://0.0.0.0:6510; empty starts
    the emulated robot.
    """
    emulated: str = USUAL_ROBOT
    """Kind of the emulated robot; `hil-bridge run --help` names the kinds."""
    velocity_mm_s: float = Field(default=50.0, gt=0, le=1000)
    """Path velocity sent with every point; upper limit of every speed of the task."""
    acceleration_mm_s2: float = Field(default=2000.0, gt=0, le=100000)
    """Acceleration of a streamed robot, and deceleration at the end of its path. A stop is immediate. Chosen."""

    @field_validator("emulated")
    @classmethod
    def _known(cls, name: str) -> str:
        try:
            ROBOTS.kind(name)
        except ConfigError as error:
            raise ValueError(str(error)) from error
        return name


class SensorConfig(_Section):
    """The force/torque sensor and its mounting."""

    url: str = ""
    """KIND+WIRE, such as jr3+can+socketcan://can0, jr3-uart+serial:///dev/ttyACM0 or netft+udp://192.168.1.1:49152;
    empty starts the emulated sensor.
    """
    emulated: str = USUAL_SENSOR
    """Kind of the emulated sensor; `hil-bridge run --help` names the kinds."""
    mounting_deg: float = 0.0
    """Rotation of the sensor about the tool's z axis: angle from the tool's x axis to the sensor's."""
    quaternion: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """Sensor frame in the tool frame, w x y z, for a sensor whose z axis is not the tool's; `mounting_deg` then
    turns it about its own z axis.
    """
    position_mm: Vector = (0.0, 0.0, 0.0)
    """Sensor's origin in the tool frame; contact moments are reported about the tool frame's origin."""
    flip_fx_mx: bool = False
    """Set it if the sensor's axes are left-handed in the tool frame: negates Fx and Mx."""
    unchecked: bool = False
    """Run although the tool's weight is unknown: the operator accepts the sensor unverified."""
    unverified: tuple[Literal["fx", "fy", "fz"], ...] = ()
    """Axes that the operator accepts although the tool's weight cannot verify them: the tool is light, or its weight
    does not lie on them. Each touch along them is then tested: the force must rise as the tool goes deeper. An approach
    goes no farther than `task.unverified_depth_mm`.
    """
    verified: tuple[Literal["fx", "fy", "fz"], ...] = ()
    """Axes that `identify tool` has verified by turning this sensor with this tool, in this mounting."""
    tare: bool = True
    """Use the sensor's reading before the movement as zero, whatever it is. Otherwise only the bias given here and
    the tool's weight are subtracted, so that a force that is already present is measured.
    """
    bias_n: Vector = (0.0, 0.0, 0.0)
    """Forces that the unloaded sensor reads, fx fy fz along its own axes; used if `tare` is false."""
    bias_nm: Vector = (0.0, 0.0, 0.0)
    """Moments that the unloaded sensor reads, mx my mz along its own axes; used if `tare` is false."""

    @field_validator("emulated")
    @classmethod
    def _known(cls, name: str) -> str:
        try:
            SENSORS.kind(name)
        except ConfigError as error:
            raise ValueError(str(error)) from error
        return name

    @field_validator("quaternion")
    @classmethod
    def _unit(cls, quaternion: Quaternion) -> Quaternion:
        if math.hypot(*quaternion) < 1e-6:
            raise ValueError("must not be the zero quaternion")
        return normalise(quaternion)


class ToolConfig(_Section):
    """The load below the sensor."""

    mass_kg: float | None = Field(default=None, ge=0)
    """Mass below the sensor, which `identify tool` measures; the sensor must read its weight before a run moves.
    Unset if unknown: an emulated cell then provides its own.
    """
    centre_of_gravity_mm: Vector = (0.0, 0.0, 0.0)
    """Position relative to the sensor's origin, along the tool frame's axes."""
    face_mm: Vector | None = None
    """Centre of the tool's end, to which the robot's position refers, relative to the sensor's origin along the tool
    frame's axes. Unset if unknown: an emulated cell then provides its own.
    """
    face_radius_mm: float | None = Field(default=None, ge=0)
    """Radius of a flat end, whose moments give its misalignment; 0 for one that touches in a point. Unset: that of the
    emulated cell, else 0.
    """


class FrameConfig(_Section):
    """The task frame: directions into the surface and along it, in the robot's base frame."""

    approach: Vector = (0.0, 0.0, -1.0)
    """Direction into the surface."""
    travel: Vector = (0.0, 1.0, 0.0)
    """Direction along the surface; perpendicular to `approach`."""
    follow_normal: bool = False
    """Control the force along the surface's normal, estimated from motion and force, and hold the speed along the
    surface. Otherwise both keep the directions given here, as in the paper.
    """
    contour: Contour = Contour()
    """How the normal is estimated, in a run without a program."""
    origin_mm: Vector | None = None
    """Origin of the work frame in the base frame, the origin of a program's paths; unset: the start point."""
    facing: Facing = Facing()
    """How a program estimates the normal, in both directions."""

    @property
    def across(self) -> Vector:
        """The work frame's y axis: x is `travel`, z points against `approach`."""
        (a, b, c), (u, v, w) = self.approach, self.travel
        return v * c - w * b, w * a - u * c, u * b - v * a

    @field_validator("approach", "travel")
    @classmethod
    def _unit(cls, vector: Vector) -> Vector:
        length = math.hypot(*vector)
        if length < 1e-9:
            raise ValueError("must not be the zero vector")
        return vector[0] / length, vector[1] / length, vector[2] / length

    @field_validator("travel")
    @classmethod
    def _perpendicular(cls, travel: Vector, info: ValidationInfo) -> Vector:
        approach = info.data.get("approach")
        if approach and abs(sum(a * b for a, b in zip(approach, travel, strict=True))) > 1e-6:
            raise ValueError("must be perpendicular to frame.approach")
        return travel


class ControllerConfig(_Section):
    """The force controller and its parameters."""

    name: str = "predictive"
    """A built-in controller or one of a plug-in; an unknown name lists them."""
    parameters: dict[str, Any] = {}
    """Parameters of that controller that differ from their defaults."""
    sample_ms: float | None = Field(default=None, gt=0)
    """Sample time that these parameters are tuned for; unset: as the controller declares, 180 ms for built-in ones. A
    control period that differs from it by more than a factor of two is refused.
    """

    @field_validator("name")
    @classmethod
    def _known(cls, name: str) -> str:
        try:
            controller_kind(name)
        except ConfigError as error:
            raise ValueError(str(error)) from error
        return name

    @field_validator("parameters")
    @classmethod
    def _fitting(cls, parameters: dict[str, Any], info: ValidationInfo) -> dict[str, Any]:
        if (name := info.data.get("name")) is not None:
            kind: Any = controller_kind(name)
            known = [field.name for field in dataclasses.fields(kind) if field.init]
            if unknown := [key for key in parameters if key not in known]:
                raise ValueError(f"{name} has no parameter {unknown[0]!r}{instead_of(known, unknown[0])}")
            try:
                adapter = TypeAdapter(kind)
            except PydanticUserError as error:
                reason = str(error).splitlines()[0]
                raise ValueError(f"{name} has a parameter that no file can contain: {reason}") from error
            adapter.validate_python(parameters)
        return parameters


class Config(_Section):
    """Everything that determines a run, except the devices themselves."""

    run: RunConfig = RunConfig()
    robot: RobotConfig = RobotConfig()
    sensor: SensorConfig = SensorConfig()
    tool: ToolConfig = ToolConfig()
    frame: FrameConfig = FrameConfig()
    task: TaskSettings = TaskSettings()
    controller: ControllerConfig = ControllerConfig()
    limits: Limits = Limits()
    oscillation: OscillationDetector = OscillationDetector()
    realtime: RealTime = RealTime()
    """Scheduling of the loop's thread; without effect in virtual time."""
    virtual: VirtualOrder = VirtualOrder()
    """Order of callbacks in virtual time; another one than the usual one searches for decisions that depend on it."""
    cell: CellSection = CellSection()
    """The emulated cell: used by `emulate`, and by `run` for a device without a URL."""
    faults: tuple[FaultConfig, ...] = ()
    """Faults to inject into the emulated cell, a table [[faults]] each; `hil-bridge list faults` lists them all."""

    @field_validator("task")
    @classmethod
    def _within_reach(cls, task: TaskSettings, info: ValidationInfo) -> TaskSettings:
        robot = info.data.get("robot")
        for name in ("speed_mm_s", "approach_speed_mm_s", "retract_speed_mm_s"):
            speed = getattr(task, name)
            if robot is not None and speed > robot.velocity_mm_s:
                raise SettingError(
                    name,
                    f"of {speed:g} mm/s is faster than the robot's path velocity: lower it, or set "
                    f"robot.velocity_mm_s, now {robot.velocity_mm_s:g}, to {speed:g} or more",
                )
        return task

    @field_validator("faults")
    @classmethod
    def _possible(cls, faults: tuple[FaultConfig, ...], info: ValidationInfo) -> tuple[FaultConfig, ...]:
        robot, sensor = info.data.get("robot"), info.data.get("sensor")
        if faults and robot is not None and sensor is not None:
            cell = EmulatedKinds.named(
                robot.emulated, sensor.emulated, getattr(info.data.get("cell"), "surface_kind", "")
            )
            for number, fault in enumerate(faults):
                try:
                    fault.check_cell(robot.url, sensor.url, cell)
                except ValueError as error:
                    place = InitErrorDetails(
                        type="value_error", loc=(number,), input=fault, ctx={"error": error}
                    )
                    raise ValidationError.from_exception_data("faults", [place]) from error
        return faults


@cache
def _config_class(chosen: Chosen) -> type[Config]:
    robots, sensors = [*map(ROBOTS.kind, chosen.robots)], [*map(SENSORS.kind, chosen.sensors)]
    robot, sensor = section_with(RobotConfig, robots), section_with(SensorConfig, sensors)
    cell = cell_with([*robots, *sensors], [*map(SURFACES.kind, chosen.surfaces)])
    fields: dict[str, Any] = {
        "robot": (robot, robot()),
        "sensor": (sensor, sensor()),
        "cell": (cell, cell()),
    }
    return create_model("Config", __base__=Config, __module__=__name__, **fields)


def with_all_kinds() -> Config:
    """Return a configuration with every setting at its default, and with the sections of all built-in kinds."""
    return _config_class(Chosen(tuple(ROBOTS.own), tuple(SENSORS.own)))()


def read_config(values: Mapping[str, Any]) -> Config:
    """Return a configuration from nested tables, with the sections of all kinds that the tables name.

    Raises pydantic's ValidationError, or ConfigError for a kind whose package is broken.
    """
    return _config_class(chosen_in(values)).model_validate(with_cell_defaults(values))


def load_config(path: Path | None, overrides: Mapping[str, object]) -> Config:
    """Return the configuration from a TOML file and overrides by dotted key. Overrides that are None are ignored.

    Raises ConfigError with the file, the key and what to do.
    """
    values: dict[str, Any] = {}
    if path is not None:
        values = read_values(path)
    given = lay_over(values, overrides)
    sources = with_program(values, str(path or "configuration"))
    try:
        return read_config(values)
    except ValidationError as error:
        raise explain(error, path, given, sources) from error


def read_values(path: Path) -> dict[str, Any]:
    """Return the values of a TOML file. Paths in the values are relative to the folder of the file. Raises
    ConfigError.
    """
    values = read_toml(path)
    resolve_files(values, path.parent)
    return values


def dump(config: Config) -> str:
    """Return the complete configuration as one line of JSON, for the recording."""
    return json.dumps(config.model_dump(mode="json"), separators=(",", ":"), sort_keys=True)


def explain(
    error: ValidationError, path: Path | None, given: set[str], sources: Mapping[str, Path] | None = None
) -> SettingRefused:
    """Return a one-line description of the first error: where, what, and what to do. `sources` maps keys to the
    files that they come from.
    """
    errors = error.errors()
    first, further = first_problem(errors), count_problems(errors) - 1
    source = str(path or "configuration")
    if (problem := describe_problem(first)) is not None:
        program = (sources or {}).get("task.step")
        table = ("task", "step") if program is None else ("step",)
        return SettingRefused(str(program or source), table, "".join(problem), "", further)
    location, got = [str(part) for part in first["loc"]], f", got {format_value(first['input'])}"
    joint = " "
    match first["type"]:
        case "extra_forbidden" | "unexpected_keyword_argument":
            instead = STEPS_HINT if location == ["step"] else _instead(location)
            text = f"is not a setting{instead}"
        case "value_error":
            cause = first["ctx"]["error"]
            if isinstance(cause, SettingError):  # a check of a complete section
                location.append(cause.setting)
                text = cause.problem
            else:
                joint = ": "
                text = str(cause)
        case "missing":  # only a vector can have missing elements
            location.pop()
            joint = ": "
            text = f"a value is missing{got}"
        case kind if kind in ("dict_type", "model_type") or is_section(_at(location)):
            text = f"must be a table of settings{got}"
        case _:
            joint = ": "
            text = f"{first['msg'].replace('Input should', 'must', 1)}{got}"
    key = ".".join(location)
    if key in given:
        return SettingRefused(OPTIONS.get(key, f"--set {key}"), (), text, joint, further)
    own = (sources or {}).get(".".join(location[:2]), source)
    return SettingRefused(str(own), location, text, joint, further)


def _with_kinds_of(location: Sequence[str]) -> Config:
    """Return the defaults of all built-in kinds, and of the plug-ins that the given key names."""
    robots, sensors, surfaces = (
        (*registry.own, *(name for name in registry.names if _is_named(registry, name, location)))
        for registry in (ROBOTS, SENSORS, SURFACES)
    )
    return _config_class(Chosen(robots, sensors, surfaces))()


def _is_named(registry: Registry[Any], name: str, location: Sequence[str]) -> bool:
    return name not in registry.own and field_name(name) in location


def _at(location: Sequence[str]) -> object:
    """Return the default value of a key in a configuration with any devices; None for an unknown key."""
    value: Any = _with_kinds_of(location)
    for part in location:
        value = getattr(value, part, None)
    return value


def _instead(location: Sequence[str]) -> str:
    """Return a suggestion of names for a mistyped key."""
    section = _at(location[:-1])
    if not is_section(section):
        return ""
    if len(location) == 1:  # a setting without its section
        homes = [
            f"{name}.{location[0]}"
            for name, field in items_of(section)
            if is_section(field) and location[0] in dict(items_of(field))
        ]
        if homes:
            return f"; did you mean {' or '.join(homes)}?"
    return instead_of([name for name, _ in items_of(section)], location[-1])
