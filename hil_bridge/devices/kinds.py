"""The kinds of robot, sensor and surface: the face that a device's room shows, and how a room is found by its name.

A URL names its kind before the wire, `KIND+WIRE`: `s3+serial:///dev/ttyUSB0`, `jr3+can+socketcan://can0`.

A package offers a kind through an entry point, by the name of the kind, as hil-bridge itself does:

    [project.entry-points."hil_bridge.robots"]
    mydev = "mydev.room:ROBOT"

Groups are `hil_bridge.robots`, `hil_bridge.sensors` and `hil_bridge.surfaces`; the objects are a `RobotKind`, a
`SensorKind` and a `SurfaceKind`. Settings of a kind are a frozen dataclass of `protocol.marks.setting` fields. They
stand in the configuration's sections `[robot.NAME]` or `[sensor.NAME]`, and `[cell.NAME]` for the emulated device.
Kinds of one device behind several receivers may share their sections.
"""

from collections.abc import Awaitable, Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields
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
    """How the bridge talks to it: `[robot.NAME]` or `[sensor.NAME]`."""
    emulated: _Emulated
    """How its emulator behaves: `[cell.NAME]`."""


def _any_wire(url: str, settings: KindSettings[Any, Any]) -> WireUrl:
    return parse_url(url, {**CONNECT_BYTES, **CONNECT_CAN, **LISTEN_DATAGRAMS, **CONNECT_DATAGRAMS})


def _not_known(settings: KindSettings[Any, Any]) -> float | None:
    return None


@dataclass(frozen=True, slots=True)
class RobotEmulation(Generic[_Client, _Emulated]):
    """The emulated robot of a kind."""

    settings: type[_Emulated]
    """Dataclass of its section `[cell.NAME]`."""
    make: Callable[[KindSettings[_Client, _Emulated]], RobotFactory]
    """A factory of robots with these settings. Raises ConfigError for a file that they name."""
    serve: Callable[[str, Any, KindSettings[_Client, _Emulated], Serving], Awaitable[str]]
    """Let the robot listen on a URL: from the URL, the robot, the settings and the wires. Gives the URL for
    its client, without the kind.
    """
    usual: Callable[[KindSettings[_Client, _Emulated], bool], str]
    """The URL to listen on where a configuration names none; the second argument says whether in virtual time."""
    faults: Mapping[str, Mapping[str, Fault]] = field(default_factory=dict)
    """Its faults, in words, by target and name; its handlers carry them out."""
    controls: Controls | None = None
    """The panel of the emulated controller, for people; None for a kind without one."""
    mishaps: Mapping[str, str] = field(default_factory=dict)
    """Faults of its target `robot` by which it refuses to move, by scenario of `hil-bridge conform`: refused, stopped.
    The other scenarios inject faults that have the same name for every robot.
    """
    late_ms: float = 20.0
    """How late what it says comes in the scenario `late`, ms."""
    play: PlayTrajectory | None = None
    """Plays a course of orders to the emulated robot over its protocol, for `identify fidelity`; None: it cannot."""
    match: MatchRobot | None = None
    """Settings under which the emulated robot shows measured figures, for `identify cell`; None: none."""
    late: LateRobot | None = None
    """Settings under which the emulated robot is as late as a recorded one, for `hil-bridge latency -o`; None: none."""


@dataclass(frozen=True, slots=True)
class RobotKind(Generic[_Client, _Emulated]):
    """A kind of robot controller."""

    name: str
    """Prefix of its URLs, and name of its sections."""
    summary: str
    """One line for people."""
    settings: type[_Client]
    """Dataclass of its section `[robot.NAME]`."""
    connect: Callable[[str, KindSettings[_Client, _Emulated], Wiring], Awaitable[Any]]
    """The robot behind a wire's URL: from the URL, the settings and its wires. Gives a
    `robots.seam.RobotLink`, not started. Raises ConfigError for the URL, TransportUnavailable for the wire.
    """
    facts: Callable[[str, KindSettings[_Client, _Emulated]], RobotFacts]
    """Facts of the robot behind a wire's URL, "" for the emulated one, before a wire is opened."""
    emulation: RobotEmulation[_Client, _Emulated] | None = None
    check: Callable[[KindSettings[_Client, _Emulated]], object] | None = None
    """Raises ConfigError for settings that no run can have, before anything is opened."""
    parse: Callable[[str, KindSettings[_Client, _Emulated]], WireUrl] = _any_wire
    """A wire's URL in its parts, for those that look at the wire alone. Raises ConfigError for one that cannot be of
    this kind.
    """
    describe: Callable[[bytes], list[dict[str, object]]] | None = None
    """Bytes of its wire of either direction, item by item with fields and problems, for people; None without words. It
    is given one datagram, a piece of a line, or a CAN frame as candump writes it, in ASCII: `201#C800`.
    """
    probe: Callable[[str, KindSettings[_Client, _Emulated], Wiring], Awaitable[Any]] | None = None
    """Probe the robot for `hil-bridge probe robot`: from the wire's URL, the settings and the wires. Returns a
    `robots.probe.ProbeResult`, and orders nothing. Errors as of `connect`, and DeviceError if nothing answers. None:
    no probe.
    """
    read_side_channel: Callable[[str], Awaitable[Any]] | None = None
    """Facts that the robot tells over another channel of its URL, a `ProbeResult` without rows where it names none. It
    reads only. Raises DeviceError where nothing answers. None: there is no such channel.
    """
    compare_file: Callable[[bytes, str, KindSettings[_Client, _Emulated]], Any] | None = None
    """Compare a file of the controller with the wire's URL and the settings, for `hil-bridge doctor`. Returns a
    `ProbeResult`: the file's content and each difference. Raises ValueError for any other file. None: no such file is
    read.
    """
    usual_wire: str = ""
    """A wire's URL of a real robot, `{host}` in the place of its address: for a URL that has no wire."""
    ruling: Mapping[Cause, Sequence[str]] = field(default_factory=dict)
    """Settings of its section that rule a cause, beside those that the table of causes names for every robot."""
    largest_turn: Callable[[KindSettings[_Client, _Emulated]], float] | None = None
    """Largest angle, rad, by which the client turns the tool away from where the robot's program began; None where it
    has no such limit.
    """


@dataclass(frozen=True, slots=True)
class SensorEmulation(Generic[_Client, _Emulated]):
    """The emulated sensor of a kind."""

    settings: type[_Emulated]
    """Dataclass of its section `[cell.NAME]`."""
    make: Callable[[KindSettings[_Client, _Emulated]], SensorFactory]
    """A factory of sensors with these settings."""
    serve: Callable[[str, Any, KindSettings[_Client, _Emulated], Serving], Awaitable[str]]
    """As of a `RobotEmulation`."""
    usual: Callable[[KindSettings[_Client, _Emulated], bool], str]
    """As of a `RobotEmulation`."""
    faults: Mapping[str, Mapping[str, Fault]] = field(default_factory=dict)
    """As of a `RobotEmulation`."""
    mishaps: Mapping[str, str] = field(default_factory=dict)
    """Faults of its target `sensor`, by scenario of `hil-bridge conform`: status. In them it says that its values are
    wrong or not new.
    """
    match: MatchSensor | None = None
    """As of a `RobotEmulation`."""
    packets_per_frame: int = 1
    """Packets on its wire that make a frame: each of them may be lost."""
    late: LateSensor | None = None
    """As of a `RobotEmulation`."""


class CanBus(NamedTuple):
    """The CAN bus of a device."""

    device: str
    """For people."""
    bitrate: int
    """bit/s"""
    messages: Callable[[Iterable[int]], Sequence[CanMessage]] | None = None
    """Its frames as field tables, for a DBC file, from identifiers of frames of this device; None without tables."""


@dataclass(frozen=True, slots=True)
class SensorKind(Generic[_Client, _Emulated]):
    """A kind of force/torque sensor, with the device that stands before it."""

    name: str
    """Prefix of its URLs, and name of its sections unless `section` names them."""
    summary: str
    """One line for people."""
    settings: type[_Client]
    """Dataclass of its section `[sensor.NAME]`."""
    connect: Callable[
        [str, KindSettings[_Client, _Emulated], Wiring], Awaitable[tuple[Transport[Any], SensorClient[Any]]]
    ]
    """The sensor behind a wire's URL: from the URL, the settings and its wires. Gives the wire and the
    client that speaks over it. Errors as of `RobotKind.connect`.
    """
    emulation: SensorEmulation[_Client, _Emulated] | None = None
    check: Callable[[KindSettings[_Client, _Emulated]], object] | None = None
    """Raises ConfigError for settings that no run can have, before anything is opened."""
    parse: Callable[[str, KindSettings[_Client, _Emulated]], WireUrl] = _any_wire
    """A wire's URL in its parts, for those that look at the wire alone. Raises ConfigError for one that cannot be of
    this kind.
    """
    describe: Callable[[bytes], list[dict[str, object]]] | None = None
    """Bytes of its wire of either direction, item by item with fields and problems, for people; None without words. It
    is given one datagram, a piece of a line, or a CAN frame as candump writes it, in ASCII: `201#C800`.
    """
    period: Callable[[KindSettings[_Client, _Emulated]], float | None] = _not_known
    """Time between two frames with these settings, s; None where it is shorter than a cycle of any robot, or not known
    before the sensor streams.
    """
    bus: CanBus | None = None
    """Bus of a device on CAN, which alone can have faults of a bus; an interface with another rate cannot reach it."""
    section: str = ""
    """Name of its sections, where kinds with the same settings share them; empty: its own name."""


@dataclass(frozen=True, slots=True)
class SurfaceKind:
    """A kind of contact between tool and surface."""

    name: str
    """Name of its section `[cell.NAME]`."""
    summary: str
    """One line for people."""
    settings: type[Any]
    """Dataclass of that section."""
    make: Callable[[Any], SurfaceFactory]
    """A factory of surfaces with these settings."""
    faults: Mapping[str, Fault] = field(default_factory=dict)
    """Faults of the surface, in words, by name; its handlers carry them out."""


DeviceKind: TypeAlias = RobotKind[Any, Any] | SensorKind[Any, Any]
_Kind = TypeVar("_Kind", RobotKind[Any, Any], SensorKind[Any, Any], SurfaceKind)


@dataclass(frozen=True, slots=True)
class Registry(Generic[_Kind]):
    """All kinds of one thing that installed packages offer. A room is imported when its kind is chosen."""

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
        """Return the kind of a name. Raises ConfigError for an unknown name, and for a kind that cannot be used."""
        found = find_plugin(self.group, self.thing, name)
        if found is None:
            known = (
                f"choose one of {', '.join(self.names)}" if self.names else "no installed package offers one"
            )
            raise ConfigError(f"there is no {self.thing} {name!r}; {known}")
        if not (isinstance(found.value, self.type) and found.value.name == name):
            raise ConfigError(f"{found.where}: {found.source} must be a {self.type.__name__} of that name")
        if fault := fault_of(found.value, _SECTIONS):
            raise ConfigError(f"{found.where}: {found.source} cannot be used: {fault}")
        return found.value

    def split(self, url: str) -> tuple[str, str]:
        """The kind that a URL names, and the wire's URL; "" where it names none."""
        name, plus, wire = url.partition("+")
        return (name, wire) if plus and name in self.names else ("", url)


@dataclass(frozen=True)
class CellSection(CellProfile):
    """Settings of every emulated cell, whatever its devices: the base of the section `[cell]`."""

    surface_kind: str = setting(
        "",
        Mark.CHOSEN,
        "kind of surface: soft-body, or one that a plug-in offers; empty: by [cell.surface]",
    )


_SECTIONS = frozenset(field.name for field in fields(CellSection))
"""Names in the section of the cell that no kind may have."""
ROBOTS: Registry[RobotKind[Any, Any]] = Registry("robot", "hil_bridge.robots", RobotKind)
SENSORS: Registry[SensorKind[Any, Any]] = Registry("sensor", "hil_bridge.sensors", SensorKind)
SURFACES: Registry[SurfaceKind] = Registry("surface", "hil_bridge.surfaces", SurfaceKind)


def section_of(kind: DeviceKind | SurfaceKind) -> str:
    """Name of a kind's sections in a configuration."""
    name = kind.section if isinstance(kind, SensorKind) and kind.section else kind.name
    return field_name(name)


def field_name(kind: str) -> str:
    """A kind's name as that of a field."""
    return kind.replace("-", "_")


def default_settings(
    kind: RobotKind[_Client, _Emulated] | SensorKind[_Client, _Emulated],
) -> KindSettings[Any, Any]:
    """The settings of a device of which a configuration says nothing."""
    return KindSettings(kind.settings(), None if kind.emulation is None else kind.emulation.settings())


def robot_of(url: str) -> tuple[RobotKind[Any, Any], str]:
    """The kind of robot that a URL names, and the wire's URL. Raises ConfigError."""
    return _kind_of(url, ROBOTS)


def sensor_of(url: str) -> tuple[SensorKind[Any, Any], str]:
    """The kind of sensor that a URL names, and the wire's URL. Raises ConfigError."""
    return _kind_of(url, SENSORS)


def _kind_of(url: str, registry: Registry[Any]) -> tuple[Any, str]:
    name, wire = registry.split(url)
    if name:
        return registry.kind(name), wire
    if meant := _meant(f"serial://{url}" if url.startswith("/") else url, registry):
        raise ConfigError(f"{url!r} names no kind of {registry.thing}; did you mean {meant}?")
    head = url.partition(":")[0]
    if examples := _with_usual_wires(url, registry):
        raise ConfigError(f"{url!r} names no wire; write {examples}")
    which = f"there is no {registry.thing} {head.partition('+')[0]!r}" if "+" in head else "it names no kind"
    raise ConfigError(f"{url!r}: {which}; choose one of {', '.join(registry.names)}, as in KIND+WIRE")


def _with_usual_wires(url: str, registry: Registry[Any]) -> str:
    """URLs to write instead of `KIND://HOST`, or of an address alone; empty for another URL."""
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


def _meant(url: str, registry: Registry[Any]) -> str:
    """Return the URLs of our kinds that take this wire, perhaps without one of its options; empty for none."""
    head, _, query = url.partition("?")
    options = [option for option in query.split("&") if option]
    for left in (options, *(options[:k] + options[k + 1 :] for k in range(len(options)))):
        wire = f"{head}?{'&'.join(left)}" if left else head
        if taking := [kind.name for kind in map(registry.kind, registry.own) if _takes(kind, wire)]:
            return " or ".join(f"{name}+{wire}" for name in taking)
    return ""


def _takes(kind: DeviceKind, wire: str) -> bool:
    """Return whether a wire's URL can be of this kind."""
    try:
        kind.parse(wire, default_settings(kind))
    except ConfigError:
        return False
    return True


Faults: TypeAlias = Mapping[str, Mapping[str, Fault]]
"""Faults by target and name."""
Describe: TypeAlias = Callable[[bytes], list[dict[str, object]]]


def describer_of(kind: DeviceKind) -> Describe | None:
    """The words for a kind's bytes. A plug-in's may raise anything: that is a problem of the bytes, in words."""
    describe = kind.describe
    if describe is None:
        return None

    def words(raw: bytes) -> list[dict[str, object]]:
        try:
            return describe(raw)
        except Exception as error:
            lines = str(error).splitlines() or [""]
            problem = f"{type(error).__name__}: {lines[0]}"
            return [{"offset": 0, "size": len(raw), "kind": "noise", "fields": [], "problems": [problem]}]

    return words


class EmulatedKinds(NamedTuple):
    """The kinds of a cell's emulated devices, and of its surface where that is a plug-in's."""

    robot: RobotKind[Any, Any]
    sensor: SensorKind[Any, Any]
    surface: SurfaceKind | None = None

    @classmethod
    def named(cls, robot: str, sensor: str, surface: str = "") -> Self:
        """The kinds with these names. Raises ConfigError."""
        return cls(ROBOTS.kind(robot), SENSORS.kind(sensor), SURFACES.kind(surface) if surface else None)

    @property
    def faults(self) -> Faults:
        """All faults that this cell can have, by target and name.

        Raises ConfigError where both devices have faults of one target: a fault would be of the one or of the other.
        """
        robot, sensor = _own_faults(self.robot), _own_faults(self.sensor)
        if shared := sorted(robot.keys() & sensor.keys()):
            raise ConfigError(
                f"the emulated {self.robot.name} and {self.sensor.name} both have faults of the target {shared[0]}: "
                "one of the two packages must call its target otherwise"
            )
        own = dict(OWN_FAULTS)
        if self.surface is not None:
            own["surface"] = self.surface.faults
        if self.sensor.bus is None:
            del own["bus"]
        return {**robot, **sensor, **own}

    @property
    def sensor_targets(self) -> Collection[str]:
        """Targets whose faults have no effect but through the emulated sensor."""
        return {"bus", "surface", "obstacle", *_own_faults(self.sensor)}

    def alternatives_for(self, on: str, fault: str, given: Mapping[str, object]) -> str:
        """The kinds of our own to choose instead, for a fault that this cell cannot have; empty for none."""
        robots = [(kind.name, self._replace(robot=kind)) for kind in map(ROBOTS.kind, ROBOTS.own)]
        sensors = [(kind.name, self._replace(sensor=kind)) for kind in map(SENSORS.kind, SENSORS.own)]
        for key, now, cells in (
            ("robot.emulated", self.robot, robots),
            ("sensor.emulated", self.sensor, sensors),
        ):
            if able := [name for name, cell in cells if cell.can_have(on, fault, given)]:
                return f"{key} = {' or '.join(able)}, not {now.name}"
        return ""

    def can_have(self, on: str, fault: str, given: Mapping[str, object]) -> bool:
        """Whether this cell can have a fault with these parameters."""
        try:
            find(self.faults, on, fault).values(fault, given)
        except ValueError:
            return False
        return True


def fault_targets() -> Collection[str]:
    """Return the targets of all faults of all devices and of every cell. A broken kind has none."""
    targets = set(OWN_FAULTS)
    registries: Sequence[Registry[Any]] = (ROBOTS, SENSORS)
    for registry in registries:
        for name in registry.names:
            with suppress(ConfigError):
                targets.update(_own_faults(registry.kind(name)))
    return targets


def _own_faults(kind: DeviceKind) -> Faults:
    return {} if kind.emulation is None else kind.emulation.faults
