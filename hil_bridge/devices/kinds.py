"""Kinds of robot, sensor and surface: the interface of a device package, and the registry that looks it up by name.

A URL names its kind before the wire, `KIND+WIRE`: `s3+serial:///dev/ttyUSB0`, `jr3+can+socketcan://can0`.

A package provides a kind through an entry point with the name of the kind, as hil-bridge itself does:

    [project.entry-points."hil_bridge.robots"]
    mydev = "mydev.room:ROBOT"

The groups are `hil_bridge.robots`, `hil_bridge.sensors` and `hil_bridge.surfaces`; the objects are a `RobotKind`, a
`SensorKind` and a `SurfaceKind`. The settings of a kind are a frozen dataclass of `protocol.marks.setting` fields. They
belong to the configuration sections `[robot.NAME]` or `[sensor.NAME]`, and `[cell.NAME]` for the emulated device. If a
device can be behind several receivers, the kinds for these receivers may share their sections.
"""

from collections.abc import Awaitable, Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Generic, NamedTuple, Self, TypeAlias, TypeVar

from emulators.cell import OWN_FAULTS, CellProfile
from emulators.faults import Fault, find
from emulators.panel import Controls
from emulators.seams import RobotFactory, SensorFactory, SurfaceFactory
from hil_bridge.devices.emulator_fit import LateRobot, LateSensor, MatchRobot, MatchSensor
from hil_bridge.devices.facts import RobotFacts
from hil_bridge.devices.kind_checks import fault_of
from hil_bridge.devices.trajectory import PlayTrajectory
from hil_bridge.devices.wiring import Serving, Wiring
from hil_bridge.errors import Cause, ConfigError
from hil_bridge.errors.extras import install_command
from hil_bridge.errors.plugins import find_plugin, own_names, plugin_names
from hil_bridge.transports import Transport
from hil_bridge.transports.urls import (
    CONNECT_BYTES,
    CONNECT_CAN,
    CONNECT_DATAGRAMS,
    LISTEN_DATAGRAMS,
    WireUrl,
    parse_url,
)
from protocol.can.dbc import CanMessage
from protocol.marks import Mark, setting
from protocol.wrench import SensorClient

_Client = TypeVar("_Client")
_Emulated = TypeVar("_Emulated")


@dataclass(frozen=True, slots=True)
class KindSettings(Generic[_Client, _Emulated]):
    """Settings of one device in a configuration."""

    client: _Client
    """Settings of the bridge's client, from the section `[robot.NAME]` or `[sensor.NAME]`."""
    emulated: _Emulated
    """Settings of the emulator, from the section `[cell.NAME]`."""


def _any_wire(url: str, settings: KindSettings[Any, Any]) -> WireUrl:
    return parse_url(url, {**CONNECT_BYTES, **CONNECT_CAN, **LISTEN_DATAGRAMS, **CONNECT_DATAGRAMS})


def _unknown_period(settings: KindSettings[Any, Any]) -> float | None:
    return None


@dataclass(frozen=True, slots=True)
class RobotEmulation(Generic[_Client, _Emulated]):
    """Emulator of a kind of robot."""

    settings: type[_Emulated]
    """Dataclass of the section `[cell.NAME]`."""
    make: Callable[[KindSettings[_Client, _Emulated]], RobotFactory]
    """Returns a factory of emulated robots with these settings. Raises ConfigError if a file named in the settings
    is invalid.
    """
    serve: Callable[[str, Any, KindSettings[_Client, _Emulated], Serving], Awaitable[str]]
    """Serves the emulated robot on a URL and returns the URL for its client, without the kind. The arguments are
    the URL, the robot, the settings and the wires.
    """
    usual: Callable[[KindSettings[_Client, _Emulated], bool], str]
    """Returns the default URL to listen on. The second argument is true in virtual time."""
    faults: Mapping[str, Mapping[str, Fault]] = field(default_factory=dict)
    """Descriptions of the emulator's faults by target and name. The emulator's handlers execute the faults."""
    controls: Controls | None = None
    """Operator panel of the emulated controller; None for a kind without one."""
    mishaps: Mapping[str, str] = field(default_factory=dict)
    """Names of the faults of the target `robot` that stop the robot, by scenario of `hil-bridge conform`: refused,
    stopped. The faults of the other scenarios have the same names for every robot.
    """
    late_ms: float = 20.0
    """Delay of the robot's messages in the scenario `late`, ms."""
    play: PlayTrajectory | None = None
    """Runs a trajectory on the emulated robot over its protocol, for `identify fidelity`. None if not supported."""
    match: MatchRobot | None = None
    """Returns settings for which the emulated robot has the measured figures, for `identify cell`. None if not
    supported.
    """
    late: LateRobot | None = None
    """Returns settings for which the emulated robot has the latency of a recorded robot, for the command
    ``hil-bridge latency -o``. None if not supported.
    """
    cell: Mapping[str, Any] = field(default_factory=dict)
    """Defaults of the section `[cell]`, as nested tables, for a robot that cannot reach the default start pose."""


@dataclass(frozen=True, slots=True)
class RobotKind(Generic[_Client, _Emulated]):
    """Kind of robot controller."""

    name: str
    """Prefix of the robot's URLs and name of its configuration sections."""
    summary: str
    """One-line description."""
    settings: type[_Client]
    """Dataclass of the section `[robot.NAME]`."""
    connect: Callable[[str, KindSettings[_Client, _Emulated], Wiring], Awaitable[Any]]
    """Connects to the robot and returns a `robots.seam.RobotLink` that is not started. The arguments are the wire's
    URL, the settings and the wires. Raises ConfigError for an invalid URL, TransportUnavailable if the wire cannot
    be opened.
    """
    facts: Callable[[str, KindSettings[_Client, _Emulated]], RobotFacts]
    """Returns the facts of the robot before a wire is opened. The URL of the wire is "" for the emulated robot."""
    emulation: RobotEmulation[_Client, _Emulated] | None = None
    check: Callable[[KindSettings[_Client, _Emulated]], object] | None = None
    """Raises ConfigError if a run cannot use the settings, before anything is opened."""
    parse: Callable[[str, KindSettings[_Client, _Emulated]], WireUrl] = _any_wire
    """Parses a wire's URL without access to a device. Raises ConfigError if the URL cannot belong to this kind."""
    describe: Callable[[bytes], list[dict[str, object]]] | None = None
    """Decodes bytes of the wire in either direction into items with fields and problems. The bytes are one
    datagram, part of a byte stream, or a CAN frame in candump's ASCII notation: `201#C800`. None if not supported.
    """
    probe: Callable[[str, KindSettings[_Client, _Emulated], Wiring], Awaitable[Any]] | None = None
    """Probes the robot for `hil-bridge probe robot`, without an order, and returns a `robots.probe.ProbeResult`.
    The arguments are the wire's URL, the settings and the wires. Errors as for `connect`, and DeviceError if the
    robot does not answer. None if the kind has no probe.
    """
    read_side_channel: Callable[[str], Awaitable[Any]] | None = None
    """Reads facts of the robot over another channel that its URL names, and changes nothing. Returns a
    `ProbeResult`, which has no rows if the URL names no such channel. Raises DeviceError if the robot does not
    answer. None if the kind has no such channel.
    """
    compare_file: Callable[[bytes, str, KindSettings[_Client, _Emulated]], Any] | None = None
    """Compares a file of the controller with the wire's URL and the settings, for `hil-bridge doctor`. Returns a
    `ProbeResult` with the content of the file and each difference. Raises ValueError for any other file. None if
    the kind reads no such file.
    """
    usual_wire: str = ""
    """Wire URL of a real robot, with `{host}` in place of its address. It is suggested for a URL without a wire."""
    ruling: Mapping[Cause, Sequence[str]] = field(default_factory=dict)
    """Settings of the robot's section that affect a cause, in addition to the settings that the table of causes
    lists for every robot.
    """
    largest_turn: Callable[[KindSettings[_Client, _Emulated]], float] | None = None
    """Returns the largest angle by which the client rotates the tool from its orientation at the start of the
    robot's program, rad. None if there is no such limit.
    """


@dataclass(frozen=True, slots=True)
class SensorEmulation(Generic[_Client, _Emulated]):
    """Emulator of a kind of sensor."""

    settings: type[_Emulated]
    """Dataclass of the section `[cell.NAME]`."""
    make: Callable[[KindSettings[_Client, _Emulated]], SensorFactory]
    """Returns a factory of emulated sensors with these settings."""
    serve: Callable[[str, Any, KindSettings[_Client, _Emulated], Serving], Awaitable[str]]
    """See `RobotEmulation.serve`."""
    usual: Callable[[KindSettings[_Client, _Emulated], bool], str]
    """See `RobotEmulation.usual`."""
    faults: Mapping[str, Mapping[str, Fault]] = field(default_factory=dict)
    """See `RobotEmulation.faults`."""
    mishaps: Mapping[str, str] = field(default_factory=dict)
    """Names of the faults of the target `sensor` that make the sensor report its values as invalid or not new, by
    scenario of `hil-bridge conform`: status.
    """
    match: MatchSensor | None = None
    """See `RobotEmulation.match`."""
    packets_per_frame: int = 1
    """Number of packets per frame on the wire, each of which may be lost."""
    late: LateSensor | None = None
    """See `RobotEmulation.late`."""


class CanBus(NamedTuple):
    """CAN bus to which a device is connected."""

    device: str
    """Name of the device in messages."""
    bitrate: int
    """Bit rate, bit/s."""
    messages: Callable[[Iterable[int]], Sequence[CanMessage]] | None = None
    """Returns the device's frames as field tables for a DBC file. The argument contains the identifiers of the
    frames. None if the device has no field tables.
    """


@dataclass(frozen=True, slots=True)
class SensorKind(Generic[_Client, _Emulated]):
    """Kind of force/torque sensor, including the gateway or receiver in front of it."""

    name: str
    """Prefix of the sensor's URLs, and name of its sections unless `section` is set."""
    summary: str
    """One-line description."""
    settings: type[_Client]
    """Dataclass of the section `[sensor.NAME]`."""
    connect: Callable[
        [str, KindSettings[_Client, _Emulated], Wiring], Awaitable[tuple[Transport[Any], SensorClient[Any]]]
    ]
    """Connects to the sensor and returns the wire and a client for it. The arguments are the wire's URL, the
    settings and the wires. Errors as for `RobotKind.connect`.
    """
    emulation: SensorEmulation[_Client, _Emulated] | None = None
    check: Callable[[KindSettings[_Client, _Emulated]], object] | None = None
    """Raises ConfigError if a run cannot use the settings, before anything is opened."""
    parse: Callable[[str, KindSettings[_Client, _Emulated]], WireUrl] = _any_wire
    """Parses a wire's URL without access to a device. Raises ConfigError if the URL cannot belong to this kind."""
    describe: Callable[[bytes], list[dict[str, object]]] | None = None
    """Decodes bytes of the wire in either direction into items with fields and problems. The bytes are one
    datagram, part of a byte stream, or a CAN frame in candump's ASCII notation: `201#C800`. None if not supported.
    """
    period: Callable[[KindSettings[_Client, _Emulated]], float | None] = _unknown_period
    """Returns the time between two frames with these settings, s. None if that time is shorter than a cycle of any
    robot, or unknown until the sensor streams.
    """
    bus: CanBus | None = None
    """CAN bus of the device, which can have bus faults; None if the device is not on CAN. An interface with a
    different bit rate cannot communicate with the device.
    """
    section: str = ""
    """Name of the configuration sections if several kinds share them and their settings; empty: that of the kind."""
    other_wires: Callable[[str, KindSettings[_Client, _Emulated]], Sequence[WireUrl]] | None = None
    """Returns the wires that the client opens besides that of `parse`, for `hil-bridge doctor`. None: no others."""


@dataclass(frozen=True, slots=True)
class SurfaceKind:
    """Kind of contact between tool and surface."""

    name: str
    """Name of the section `[cell.NAME]`."""
    summary: str
    """One-line description."""
    settings: type[Any]
    """Dataclass of the section `[cell.NAME]`."""
    make: Callable[[Any], SurfaceFactory]
    """Returns a factory of surfaces with these settings."""
    faults: Mapping[str, Fault] = field(default_factory=dict)
    """Descriptions of the surface's faults by name. The surface's handlers execute the faults."""


DeviceKind: TypeAlias = RobotKind[Any, Any] | SensorKind[Any, Any]
_Kind = TypeVar("_Kind", RobotKind[Any, Any], SensorKind[Any, Any], SurfaceKind)


@dataclass(frozen=True, slots=True)
class Registry(Generic[_Kind]):
    """Registry of all kinds of robot, sensor or surface that installed packages provide. A package is imported when
    one of its kinds is selected.
    """

    thing: str
    group: str
    type: type[_Kind]

    @property
    def names(self) -> Sequence[str]:
        """Names of all kinds, sorted."""
        return plugin_names(self.group)

    @property
    def own(self) -> Sequence[str]:
        """Names of the kinds that are part of hil-bridge, sorted."""
        return own_names(self.group)

    def kind(self, name: str) -> _Kind:
        """Return the kind with this name. Raises ConfigError if the name is unknown or the kind is invalid."""
        plugin = find_plugin(self.group, self.thing, name)
        if plugin is None:
            self.refuse_outdated(name)
            raise ConfigError(f"there is no {self.thing} {name!r}; choose one of {', '.join(self.names)}")
        if not (isinstance(plugin.value, self.type) and plugin.value.name == name):
            raise ConfigError(
                f"{plugin.where}: {plugin.source} must be a {self.type.__name__} with that name"
            )
        if fault := fault_of(plugin.value, _SECTIONS):
            raise ConfigError(f"{plugin.where}: {plugin.source} is invalid: {fault}")
        return plugin.value

    def refuse_outdated(self, name: str) -> None:
        """Raise ConfigError if the entry point of a built-in kind is missing, which happens in a checkout that was
        updated but not installed again.
        """
        room = Path(__file__).parent / f"{self.thing}s" / field_name(name) / "room.py"
        if not self.own or (name not in self.names and room.is_file()):
            raise ConfigError(
                f"the {self.thing} {name!r} is not installed",
                remedy=f"install hil-bridge again: {install_command()}",
            )

    def split(self, url: str) -> tuple[str, str]:
        """Split a URL into its kind and the wire's URL. The kind is "" if the URL names none."""
        name, plus, wire = url.partition("+")
        return (name, wire) if plus and name in self.names else ("", url)


@dataclass(frozen=True)
class CellSection(CellProfile):
    """Settings common to all emulated cells, independent of the devices. Base class of the section `[cell]`."""

    surface_kind: str = setting(
        "",
        Mark.CHOSEN,
        "kind of surface: soft-body, or one from a plug-in; empty: by [cell.surface]",
    )


_SECTIONS = frozenset(field.name for field in fields(CellSection))
"""Field names of the section `[cell]`, which cannot be names of kinds."""
ROBOTS: Registry[RobotKind[Any, Any]] = Registry("robot", "hil_bridge.robots", RobotKind)
SENSORS: Registry[SensorKind[Any, Any]] = Registry("sensor", "hil_bridge.sensors", SensorKind)
SURFACES: Registry[SurfaceKind] = Registry("surface", "hil_bridge.surfaces", SurfaceKind)


def section_of(kind: DeviceKind | SurfaceKind) -> str:
    """Return the name of the configuration sections of a kind."""
    name = kind.section if isinstance(kind, SensorKind) and kind.section else kind.name
    return field_name(name)


def field_name(kind: str) -> str:
    """Return the name of a kind, converted to a field name."""
    return kind.replace("-", "_")


def default_settings(
    kind: RobotKind[_Client, _Emulated] | SensorKind[_Client, _Emulated],
) -> KindSettings[Any, Any]:
    """Return the default settings of a device."""
    return KindSettings(kind.settings(), None if kind.emulation is None else kind.emulation.settings())


def robot_of(url: str) -> tuple[RobotKind[Any, Any], str]:
    """Return the kind of robot that a URL names, and the wire's URL. Raises ConfigError if the URL is invalid."""
    return _kind_of(url, ROBOTS)


def sensor_of(url: str) -> tuple[SensorKind[Any, Any], str]:
    """Return the kind of sensor that a URL names, and the wire's URL. Raises ConfigError if the URL is invalid."""
    return _kind_of(url, SENSORS)


def _kind_of(url: str, registry: Registry[Any]) -> tuple[Any, str]:
    name, wire = registry.split(url)
    if name:
        return registry.kind(name), wire
    if suggestions := _suggestions(f"serial://{url}" if url.startswith("/") else url, registry):
        raise ConfigError(f"{url!r} names no kind of {registry.thing}; did you mean {suggestions}?")
    head = url.partition(":")[0]
    registry.refuse_outdated(head.partition("+")[0])
    if examples := _with_usual_wires(url, registry):
        raise ConfigError(f"{url!r} names no wire; write {examples}")
    which = f"there is no {registry.thing} {head.partition('+')[0]!r}" if "+" in head else "it names no kind"
    raise ConfigError(f"{url!r}: {which}; choose one of {', '.join(registry.names)}, as in KIND+WIRE")


def _with_usual_wires(url: str, registry: Registry[Any]) -> str:
    """Return the complete URLs to suggest for `KIND://HOST` or for a bare address, or "" for any other URL."""
    name, colon, rest = url.partition("://")
    host = (rest if colon else url).partition("/")[0]
    plain = host.replace(".", "").replace("-", "")
    if not (plain.isascii() and plain.isalnum()) or (colon and name not in registry.names):
        return ""
    if not colon and "." not in host and host != "localhost":
        return ""
    kinds = [registry.kind(name)] if colon else map(registry.kind, registry.own)
    wires = ((kind.name, getattr(kind, "usual_wire", "")) for kind in kinds)
    return " or ".join(f"{kind}+{wire.format(host=host)}" for kind, wire in wires if wire)


def _suggestions(url: str, registry: Registry[Any]) -> str:
    """Return the URLs of built-in kinds that accept this wire, if necessary without one of its options, or "" if
    there are none.
    """
    head, _, query = url.partition("?")
    options = [option for option in query.split("&") if option]
    for left in (options, *(options[:k] + options[k + 1 :] for k in range(len(options)))):
        wire = f"{head}?{'&'.join(left)}" if left else head
        if kinds := [kind.name for kind in map(registry.kind, registry.own) if _accepts(kind, wire)]:
            return " or ".join(f"{name}+{wire}" for name in kinds)
    return ""


def _accepts(kind: DeviceKind, wire: str) -> bool:
    """Return whether a wire's URL can belong to this kind."""
    try:
        kind.parse(wire, default_settings(kind))
    except ConfigError:
        return False
    return True


Faults: TypeAlias = Mapping[str, Mapping[str, Fault]]
"""Faults by target and name."""
Describe: TypeAlias = Callable[[bytes], list[dict[str, object]]]


def describer_of(kind: DeviceKind) -> Describe | None:
    """Return the decoder of a kind, or None if it has none. An exception in the decoder of a plug-in is reported as
    a problem of the decoded bytes.
    """
    describe = kind.describe
    if describe is None:
        return None

    def decode(raw: bytes) -> list[dict[str, object]]:
        try:
            return describe(raw)
        except Exception as error:
            lines = str(error).splitlines() or [""]
            problem = f"{type(error).__name__}: {lines[0]}"
            return [{"offset": 0, "size": len(raw), "kind": "noise", "fields": [], "problems": [problem]}]

    return decode


class EmulatedKinds(NamedTuple):
    """Kinds of a cell's emulated devices, and of its surface if a plug-in provides the surface."""

    robot: RobotKind[Any, Any]
    sensor: SensorKind[Any, Any]
    surface: SurfaceKind | None = None

    @classmethod
    def named(cls, robot: str, sensor: str, surface: str = "") -> Self:
        """Return the kinds with these names. Raises ConfigError if a name is unknown."""
        return cls(ROBOTS.kind(robot), SENSORS.kind(sensor), SURFACES.kind(surface) if surface else None)

    @property
    def faults(self) -> Faults:
        """Faults that this cell can have, by target and name.

        Raises ConfigError if both devices have faults for the same target, because the target would be ambiguous.
        """
        robot, sensor = _own_faults(self.robot), _own_faults(self.sensor)
        if shared := sorted(robot.keys() & sensor.keys()):
            raise ConfigError(
                f"the emulated {self.robot.name} and {self.sensor.name} both define faults for the target {shared[0]}: "
                "one of the two packages must rename its target"
            )
        own = dict(OWN_FAULTS)
        if self.surface is not None:
            own["surface"] = self.surface.faults
        if self.sensor.bus is None:
            del own["bus"]
        return {**robot, **sensor, **own}

    @property
    def sensor_targets(self) -> Collection[str]:
        """Targets whose faults take effect only through the emulated sensor."""
        return {"bus", "surface", "obstacle", *_own_faults(self.sensor)}

    def alternatives_for(self, on: str, fault: str, given: Mapping[str, object]) -> str:
        """Return the built-in kinds that support a fault which this cell does not, or "" if there are none."""
        robots = [(kind.name, self._replace(robot=kind)) for kind in map(ROBOTS.kind, ROBOTS.own)]
        sensors = [(kind.name, self._replace(sensor=kind)) for kind in map(SENSORS.kind, SENSORS.own)]
        for key, now, cells in (
            ("robot.emulated", self.robot, robots),
            ("sensor.emulated", self.sensor, sensors),
        ):
            if names := [name for name, cell in cells if cell.can_have(on, fault, given)]:
                return f"{key} = {' or '.join(names)}, not {now.name}"
        return ""

    def can_have(self, on: str, fault: str, given: Mapping[str, object]) -> bool:
        """Return whether this cell supports a fault with these parameters."""
        try:
            find(self.faults, on, fault).values(fault, given)
        except ValueError:
            return False
        return True


def fault_targets() -> Collection[str]:
    """Return the fault targets of all device kinds and of every cell. Invalid kinds are skipped."""
    targets = set(OWN_FAULTS)
    registries: Sequence[Registry[Any]] = (ROBOTS, SENSORS)
    for registry in registries:
        for name in registry.names:
            with suppress(ConfigError):
                targets.update(_own_faults(registry.kind(name)))
    return targets


def _own_faults(kind: DeviceKind) -> Faults:
    return {} if kind.emulation is None else kind.emulation.faults
