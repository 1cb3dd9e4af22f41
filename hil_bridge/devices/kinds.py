"""Kinds of robot, sensor and surface: the interface of a device package, and the registry that looks it up by name.

A URL names its kind before the wire, `KIND+WIRE`: `s3+serial:///dev/ttyUSB0`, `jr3+can+socketcan://can0`.

A package offers a kind through an entry point with the name of the kind, as hil-bridge itself does:

    [project.entry-points."hil_bridge.robots"]
    mydev = "mydev.room:ROBOT"

The groups are `hil_bridge.robots`, `hil_bridge.sensors` and `hil_bridge.surfaces`; the objects are a `RobotKind`, a
`SensorKind` and a `SurfaceKind`. The settings of a kind are a frozen dataclass of `protocol.marks.setting` fields. They
belong to the configuration sections `[robot.NAME]` or `[sensor.NAME]`, and `[cell.NAME]` for the emulated device. Kinds
of one device behind several receivers may share their sections.
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
    """Settings of one device, from a configuration."""

    client: _Client
    """Settings of the bridge's client: `[robot.NAME]` or `[sensor.NAME]`."""
    emulated: _Emulated
    """Settings of the emulator: `[cell.NAME]`."""


def _any_wire(url: str, settings: KindSettings[Any, Any]) -> WireUrl:
    return parse_url(url, {**CONNECT_BYTES, **CONNECT_CAN, **LISTEN_DATAGRAMS, **CONNECT_DATAGRAMS})


def _unknown_period(settings: KindSettings[Any, Any]) -> float | None:
    return None


@dataclass(frozen=True, slots=True)
class RobotEmulation(Generic[_Client, _Emulated]):
    """Emulated robot of a kind."""

    settings: type[_Emulated]
    """Dataclass of its section `[cell.NAME]`."""
    make: Callable[[KindSettings[_Client, _Emulated]], RobotFactory]
    """Returns a factory of robots with these settings. Raises ConfigError for a file that they name."""
    serve: Callable[[str, Any, KindSettings[_Client, _Emulated], Serving], Awaitable[str]]
    """Serves the robot on a URL: from the URL, the robot, the settings and the wires. Returns the URL for its client,
    without the kind.
    """
    usual: Callable[[KindSettings[_Client, _Emulated], bool], str]
    """Returns the default URL to listen on; the second argument is true in virtual time."""
    faults: Mapping[str, Mapping[str, Fault]] = field(default_factory=dict)
    """Descriptions of its faults by target and name; its handlers execute them."""
    controls: Controls | None = None
    """Operator panel of the emulated controller; None for a kind without one."""
    mishaps: Mapping[str, str] = field(default_factory=dict)
    """Faults of its target `robot` that stop it, by scenario of `hil-bridge conform`: refused, stopped. The other
    scenarios inject faults that have the same name for every robot.
    """
    late_ms: float = 20.0
    """Delay of its messages in the scenario `late`, ms."""
    play: PlayTrajectory | None = None
    """Runs a trajectory on the emulated robot over its protocol, for `identify fidelity`; None: not supported."""
    match: MatchRobot | None = None
    """Returns settings with which the emulated robot has the measured figures, for `identify cell`; None: not
    supported.
    """
    late: LateRobot | None = None
    """Returns settings with which the emulated robot has the latency of a recorded one, for `hil-bridge latency -o`;
    None: not supported.
    """


@dataclass(frozen=True, slots=True)
class RobotKind(Generic[_Client, _Emulated]):
    """Kind of robot controller."""

    name: str
    """Prefix of its URLs, and name of its sections."""
    summary: str
    """One-line description."""
    settings: type[_Client]
    """Dataclass of its section `[robot.NAME]`."""
    connect: Callable[[str, KindSettings[_Client, _Emulated], Wiring], Awaitable[Any]]
    """Connects to the robot behind a wire's URL: from the URL, the settings and its wires. Returns a
    `robots.seam.RobotLink` that is not started. Raises ConfigError for the URL, TransportUnavailable for the wire.
    """
    facts: Callable[[str, KindSettings[_Client, _Emulated]], RobotFacts]
    """Returns the facts of the robot behind a wire's URL, "" for the emulated one, before a wire is opened."""
    emulation: RobotEmulation[_Client, _Emulated] | None = None
    check: Callable[[KindSettings[_Client, _Emulated]], object] | None = None
    """Raises ConfigError for settings that no run can use, before anything is opened."""
    parse: Callable[[str, KindSettings[_Client, _Emulated]], WireUrl] = _any_wire
    """Parses a wire's URL, without the robot or sensor. Raises ConfigError if it cannot belong to this kind."""
    describe: Callable[[bytes], list[dict[str, object]]] | None = None
    """Decodes bytes of its wire in either direction, item by item, with fields and problems; None: not supported. It
    receives one datagram, a piece of a byte stream, or a CAN frame as candump prints it, in ASCII: `201#C800`.
    """
    probe: Callable[[str, KindSettings[_Client, _Emulated], Wiring], Awaitable[Any]] | None = None
    """Probes the robot for `hil-bridge probe robot`: from the wire's URL, the settings and the wires. Returns a
    `robots.probe.ProbeResult`, and orders nothing. Errors as for `connect`, and DeviceError if nothing answers. None:
    no probe.
    """
    read_side_channel: Callable[[str], Awaitable[Any]] | None = None
    """Reads facts of the robot over another channel of its URL, and changes nothing. Returns a `ProbeResult`, without
    rows if the URL names no such channel. Raises DeviceError if nothing answers. None: no such channel.
    """
    compare_file: Callable[[bytes, str, KindSettings[_Client, _Emulated]], Any] | None = None
    """Compares a file of the controller with the wire's URL and the settings, for `hil-bridge doctor`. Returns a
    `ProbeResult`: the file's content and each difference. Raises ValueError for any other file. None: no such file is
    read.
    """
    usual_wire: str = ""
    """Wire URL of a real robot with `{host}` as its address, suggested for a URL without a wire."""
    ruling: Mapping[Cause, Sequence[str]] = field(default_factory=dict)
    """Settings of its section that govern a cause, in addition to those that the table of causes lists for every robot.
    """
    largest_turn: Callable[[KindSettings[_Client, _Emulated]], float] | None = None
    """Returns the largest angle, rad, by which the client rotates the tool away from where the robot's program began;
    None: no such limit.
    """


@dataclass(frozen=True, slots=True)
class SensorEmulation(Generic[_Client, _Emulated]):
    """Emulated sensor of a kind."""

    settings: type[_Emulated]
    """Dataclass of its section `[cell.NAME]`."""
    make: Callable[[KindSettings[_Client, _Emulated]], SensorFactory]
    """Returns a factory of sensors with these settings."""
    serve: Callable[[str, Any, KindSettings[_Client, _Emulated], Serving], Awaitable[str]]
    """As for a `RobotEmulation`."""
    usual: Callable[[KindSettings[_Client, _Emulated], bool], str]
    """As for a `RobotEmulation`."""
    faults: Mapping[str, Mapping[str, Fault]] = field(default_factory=dict)
    """As for a `RobotEmulation`."""
    mishaps: Mapping[str, str] = field(default_factory=dict)
    """Faults of its target `sensor`, by scenario of `hil-bridge conform`: status. With them, it reports that its values
    are wrong or not new.
    """
    match: MatchSensor | None = None
    """As for a `RobotEmulation`."""
    packets_per_frame: int = 1
    """Packets of its wire per frame, each of which may be lost."""
    late: LateSensor | None = None
    """As for a `RobotEmulation`."""


class CanBus(NamedTuple):
    """CAN bus of a device."""

    device: str
    """Name of the device in messages."""
    bitrate: int
    """bit/s"""
    messages: Callable[[Iterable[int]], Sequence[CanMessage]] | None = None
    """Returns its frames as field tables, for a DBC file, from the identifiers of the device's frames; None without
    tables.
    """


@dataclass(frozen=True, slots=True)
class SensorKind(Generic[_Client, _Emulated]):
    """Kind of force/torque sensor, including the gateway or receiver in front of it."""

    name: str
    """Prefix of its URLs, and name of its sections unless `section` names them."""
    summary: str
    """One-line description."""
    settings: type[_Client]
    """Dataclass of its section `[sensor.NAME]`."""
    connect: Callable[
        [str, KindSettings[_Client, _Emulated], Wiring], Awaitable[tuple[Transport[Any], SensorClient[Any]]]
    ]
    """Connects to the sensor behind a wire's URL: from the URL, the settings and its wires. Returns the wire and the
    client for it. Errors as for `RobotKind.connect`.
    """
    emulation: SensorEmulation[_Client, _Emulated] | None = None
    check: Callable[[KindSettings[_Client, _Emulated]], object] | None = None
    """Raises ConfigError for settings that no run can use, before anything is opened."""
    parse: Callable[[str, KindSettings[_Client, _Emulated]], WireUrl] = _any_wire
    """Parses a wire's URL, without the robot or sensor. Raises ConfigError if it cannot belong to this kind."""
    describe: Callable[[bytes], list[dict[str, object]]] | None = None
    """Decodes bytes of its wire in either direction, item by item, with fields and problems; None: not supported. It
    receives one datagram, a piece of a byte stream, or a CAN frame as candump prints it, in ASCII: `201#C800`.
    """
    period: Callable[[KindSettings[_Client, _Emulated]], float | None] = _unknown_period
    """Returns the time between two frames with these settings, s; None if it is shorter than a cycle of any robot, or
    unknown before the sensor streams.
    """
    bus: CanBus | None = None
    """Bus of a device on CAN, which can have bus faults. An interface with another bit rate cannot communicate with it.
    """
    section: str = ""
    """Name of its sections, if kinds with the same settings share them; empty: its own name."""


@dataclass(frozen=True, slots=True)
class SurfaceKind:
    """Kind of contact between tool and surface."""

    name: str
    """Name of its section `[cell.NAME]`."""
    summary: str
    """One-line description."""
    settings: type[Any]
    """Dataclass of that section."""
    make: Callable[[Any], SurfaceFactory]
    """Returns a factory of surfaces with these settings."""
    faults: Mapping[str, Fault] = field(default_factory=dict)
    """Descriptions of the surface's faults by name; its handlers execute them."""


DeviceKind: TypeAlias = RobotKind[Any, Any] | SensorKind[Any, Any]
_Kind = TypeVar("_Kind", RobotKind[Any, Any], SensorKind[Any, Any], SurfaceKind)


@dataclass(frozen=True, slots=True)
class Registry(Generic[_Kind]):
    """All kinds of robot, sensor or surface that installed packages offer. A package is imported when its kind is
    selected.
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
        """Names of the kinds that come with hil-bridge, sorted."""
        return own_names(self.group)

    def kind(self, name: str) -> _Kind:
        """Return the kind of a name. Raises ConfigError for an unknown name and for an invalid kind."""
        found = find_plugin(self.group, self.thing, name)
        if found is None:
            self.refuse_outdated(name)
            raise ConfigError(f"there is no {self.thing} {name!r}; choose one of {', '.join(self.names)}")
        if not (isinstance(found.value, self.type) and found.value.name == name):
            raise ConfigError(f"{found.where}: {found.source} must be a {self.type.__name__} with that name")
        if fault := fault_of(found.value, _SECTIONS):
            raise ConfigError(f"{found.where}: {found.source} is invalid: {fault}")
        return found.value

    def refuse_outdated(self, name: str) -> None:
        """Raise ConfigError for a kind of hil-bridge whose entry point is missing, as in a checkout that was updated
        without installing it again.
        """
        room = Path(__file__).parent / f"{self.thing}s" / field_name(name) / "room.py"
        if not self.own or (name not in self.names and room.is_file()):
            raise ConfigError(
                f"the {self.thing} {name!r} is not installed",
                remedy=f"install hil-bridge again: {install_command()}",
            )

    def split(self, url: str) -> tuple[str, str]:
        """Split a URL into its kind, "" if it names none, and the wire's URL."""
        name, plus, wire = url.partition("+")
        return (name, wire) if plus and name in self.names else ("", url)


@dataclass(frozen=True)
class CellSection(CellProfile):
    """Settings of every emulated cell, independent of its devices: base of the section `[cell]`."""

    surface_kind: str = setting(
        "",
        Mark.CHOSEN,
        "kind of surface: soft-body, or one that a plug-in offers; empty: by [cell.surface]",
    )


_SECTIONS = frozenset(field.name for field in fields(CellSection))
"""Field names of the section `[cell]`, which no kind may use."""
ROBOTS: Registry[RobotKind[Any, Any]] = Registry("robot", "hil_bridge.robots", RobotKind)
SENSORS: Registry[SensorKind[Any, Any]] = Registry("sensor", "hil_bridge.sensors", SensorKind)
SURFACES: Registry[SurfaceKind] = Registry("surface", "hil_bridge.surfaces", SurfaceKind)


def section_of(kind: DeviceKind | SurfaceKind) -> str:
    """Return the name of a kind's sections in a configuration."""
    name = kind.section if isinstance(kind, SensorKind) and kind.section else kind.name
    return field_name(name)


def field_name(kind: str) -> str:
    """Return a kind's name as a field name."""
    return kind.replace("-", "_")


def default_settings(
    kind: RobotKind[_Client, _Emulated] | SensorKind[_Client, _Emulated],
) -> KindSettings[Any, Any]:
    """Return the default settings of a device."""
    return KindSettings(kind.settings(), None if kind.emulation is None else kind.emulation.settings())


def robot_of(url: str) -> tuple[RobotKind[Any, Any], str]:
    """Return the kind of robot that a URL names, and the wire's URL. Raises ConfigError."""
    return _kind_of(url, ROBOTS)


def sensor_of(url: str) -> tuple[SensorKind[Any, Any], str]:
    """Return the kind of sensor that a URL names, and the wire's URL. Raises ConfigError."""
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
    """Return complete URLs to suggest for `KIND://HOST` or for an address alone; "" for any other URL."""
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
    """Return the URLs of our own kinds that accept this wire, perhaps without one of its options; "" for no match."""
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
    """Return the decoder of a kind's bytes, if it has one. Any exception of a plug-in's decoder is reported as a
    problem of the bytes.
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
    """Kinds of a cell's emulated devices, and of its surface if a plug-in provides that."""

    robot: RobotKind[Any, Any]
    sensor: SensorKind[Any, Any]
    surface: SurfaceKind | None = None

    @classmethod
    def named(cls, robot: str, sensor: str, surface: str = "") -> Self:
        """Return the kinds with these names. Raises ConfigError."""
        return cls(ROBOTS.kind(robot), SENSORS.kind(sensor), SURFACES.kind(surface) if surface else None)

    @property
    def faults(self) -> Faults:
        """All faults that this cell can have, by target and name.

        Raises ConfigError if both devices have faults for one target, which would be ambiguous.
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
        """Targets whose faults act only through the emulated sensor."""
        return {"bus", "surface", "obstacle", *_own_faults(self.sensor)}

    def alternatives_for(self, on: str, fault: str, given: Mapping[str, object]) -> str:
        """Return the kinds of our own that offer a fault which this cell cannot have; "" if there are none."""
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
        """Return whether this cell can have a fault with these parameters."""
        try:
            find(self.faults, on, fault).values(fault, given)
        except ValueError:
            return False
        return True


def fault_targets() -> Collection[str]:
    """Return the fault targets of all devices and of every cell. An invalid kind has none."""
    targets = set(OWN_FAULTS)
    registries: Sequence[Registry[Any]] = (ROBOTS, SENSORS)
    for registry in registries:
        for name in registry.names:
            with suppress(ConfigError):
                targets.update(_own_faults(registry.kind(name)))
    return targets


def _own_faults(kind: DeviceKind) -> Faults:
    return {} if kind.emulation is None else kind.emulation.faults
