"""The kinds of robot, sensor and surface: the face that a device's room shows, and how a room is found by its name.

A URL names its kind before the wire, `KIND+WIRE`: `s3+serial:///dev/ttyUSB0`, `jr3+can+socketcan://can0`. A URL
without a kind is one of the S3 or of a JR3, which were here first.

Another package offers a kind through an entry point, by the name of the kind:

    [project.entry-points."hil_bridge.robots"]
    mydev = "mydev.room:ROBOT"

Groups are `hil_bridge.robots`, `hil_bridge.sensors` and `hil_bridge.surfaces`; the objects are a `RobotKind`, a
`SensorKind` and a `SurfaceKind`. Settings of a kind are a frozen dataclass of `protocol.marks.setting` fields. They
stand in the configuration's sections `[robot.NAME]` or `[sensor.NAME]`, and `[cell.NAME]` for the emulated device.
"""

from collections.abc import Awaitable, Callable, Mapping, Sequence
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass, field, fields
from importlib import import_module
from typing import Any, Generic, NamedTuple, TypeAlias, TypeVar

from emulators.cell import OWN_FAULTS, CellProfile
from emulators.faults import Fault
from emulators.seams import RobotFactory, SensorFactory, SurfaceFactory
from hil_bridge.devices.facts import RobotFacts
from hil_bridge.devices.kind_checks import fault_of
from hil_bridge.devices.wiring import Serving, Wiring
from hil_bridge.errors import ConfigError
from hil_bridge.errors.plugins import find_plugin, plugin_names
from hil_bridge.transports import Transport
from hil_bridge.transports.urls import (
    CONNECT_BYTES,
    CONNECT_CAN,
    CONNECT_DATAGRAMS,
    LISTEN_DATAGRAMS,
    WireUrl,
    parse_url,
)
from protocol.marks import Mark, setting
from protocol.wrench import SensorClient

_ROBOTS = {
    "s3": "hil_bridge.devices.robots.s3.room:ROBOT",
    "egm": "hil_bridge.devices.robots.egm.room:ROBOT",
    "rsi": "hil_bridge.devices.robots.rsi.room:ROBOT",
    "rtde": "hil_bridge.devices.robots.rtde.room:ROBOT",
}
_SENSORS = {
    "jr3": "hil_bridge.devices.sensors.jr3.room:CAN_GATEWAY",
    "jr3-uart": "hil_bridge.devices.sensors.jr3.room:UART_GATEWAY",
    "jr3-board": "hil_bridge.devices.sensors.jr3.room:RECEIVER_BOARD",
    "netft": "hil_bridge.devices.sensors.netft.room:SENSOR",
    "ft300": "hil_bridge.devices.sensors.ft300.room:SENSOR",
    "ati-can": "hil_bridge.devices.sensors.ati_can.room:SENSOR",
}


@dataclass(frozen=True, slots=True)
class KindSettings:
    """Settings of one device, from a configuration."""

    client: Any
    """How the bridge talks to it: `[robot.NAME]` or `[sensor.NAME]`."""
    emulated: Any
    """How its emulator behaves: `[cell.NAME]`."""


def _any_wire(url: str, settings: KindSettings) -> WireUrl:
    return parse_url(url, {**CONNECT_BYTES, **CONNECT_CAN, **LISTEN_DATAGRAMS, **CONNECT_DATAGRAMS})


def _not_mine(url: str) -> str | None:
    return None


def _not_known(settings: KindSettings) -> float | None:
    return None


class Mishap(NamedTuple):
    """A fault by which a client of an emulated robot is tried."""

    on: str
    fault: str
    parameters: Mapping[str, object] = {}


@dataclass(frozen=True, slots=True)
class RobotEmulation:
    """The emulated robot of a kind."""

    settings: type[Any]
    """Dataclass of its section `[cell.NAME]`."""
    make: Callable[[KindSettings], RobotFactory]
    """A factory of robots with these settings. Raises ConfigError for a file that they name."""
    serve: Callable[[str, Any, KindSettings, Serving], Awaitable[str]]
    """Let the robot listen on a URL: from the URL, the robot, the settings and the wires. Gives the URL for
    its client, without the kind.
    """
    usual: Callable[[KindSettings, bool], str]
    """The URL to listen on where a configuration names none; the second argument says whether in virtual time."""
    faults: Mapping[str, Mapping[str, Fault]] = field(default_factory=dict)
    """Its faults, in words, by target and name; its handlers carry them out."""
    panel: Callable[..., AbstractAsyncContextManager[str]] | None = None
    """The panel of the emulated controller, for people; None for a kind without one."""
    check_panel: Callable[[str], object] | None = None
    """Raises ConfigError for a URL at which no panel can listen."""
    mishaps: Mapping[str, Sequence[Mishap]] = field(default_factory=dict)
    """Faults that `hil-bridge conform` injects, by scenario: late, refused, stopped, emergency, cut. Those of `cut` are
    given their duration.
    """


@dataclass(frozen=True, slots=True)
class RobotKind:
    """A kind of robot controller."""

    name: str
    """Prefix of its URLs, and name of its sections."""
    summary: str
    """One line for people."""
    settings: type[Any]
    """Dataclass of its section `[robot.NAME]`."""
    connect: Callable[[str, KindSettings, Wiring], Awaitable[Any]]
    """The robot behind a wire's URL: from the URL, the settings and its wires. Gives a
    `robots.seam.RobotLink`, not started. Raises ConfigError for the URL, TransportUnavailable for the wire.
    """
    facts: Callable[[str, KindSettings], RobotFacts]
    """Facts of the robot behind a wire's URL, "" for the emulated one, before a wire is opened."""
    emulation: RobotEmulation | None = None
    directly: bool = False
    """Its settings stand in `[robot]` and `[cell]` themselves, as they did when there was no other robot."""
    check: Callable[[KindSettings], object] | None = None
    """Raises ConfigError for settings that no run can have, before anything is opened."""
    parse: Callable[[str, KindSettings], WireUrl] = _any_wire
    """A wire's URL in its parts, for those that look at the wire alone. Raises ConfigError for one that cannot be of
    this kind.
    """
    describe: Callable[[bytes], list[dict[str, object]]] | None = None
    """Bytes of its wire of either direction, item by item with fields and problems, for people; None without words. It
    is given one datagram, a piece of a line, or a CAN frame as candump writes it, in ASCII: `201#C800`.
    """


@dataclass(frozen=True, slots=True)
class SensorEmulation:
    """The emulated sensor of a kind."""

    settings: type[Any]
    """Dataclass of its section `[cell.NAME]`."""
    make: Callable[[KindSettings], SensorFactory]
    """A factory of sensors with these settings."""
    serve: Callable[[str, Any, KindSettings, Serving], Awaitable[str]]
    """As of a `RobotEmulation`."""
    usual: Callable[[KindSettings, bool], str]
    """As of a `RobotEmulation`."""
    faults: Mapping[str, Mapping[str, Fault]] = field(default_factory=dict)
    """As of a `RobotEmulation`."""


class CanBus(NamedTuple):
    """The CAN bus of a device."""

    device: str
    """For people."""
    bitrate: int
    """bit/s"""


@dataclass(frozen=True, slots=True)
class SensorKind:
    """A kind of force/torque sensor, with the device that stands before it."""

    name: str
    """Prefix of its URLs, and name of its sections."""
    summary: str
    """One line for people."""
    settings: type[Any]
    """Dataclass of its section `[sensor.NAME]`."""
    connect: Callable[[str, KindSettings, Wiring], Awaitable[tuple[Transport[Any], SensorClient[Any]]]]
    """The sensor behind a wire's URL: from the URL, the settings and its wires. Gives the wire and the
    client that speaks over it. Errors as of `RobotKind.connect`.
    """
    emulation: SensorEmulation | None = None
    directly: bool = False
    """Its settings stand in `[sensor]` and `[cell]` themselves, as they did when there was no other sensor."""
    older_form: Callable[[str], str | None] = _not_mine
    """The wire's URL of a URL without a kind that means this kind of sensor; None for every other URL."""
    check: Callable[[KindSettings], object] | None = None
    """Raises ConfigError for settings that no run can have, before anything is opened."""
    parse: Callable[[str, KindSettings], WireUrl] = _any_wire
    """A wire's URL in its parts, for those that look at the wire alone. Raises ConfigError for one that cannot be of
    this kind.
    """
    describe: Callable[[bytes], list[dict[str, object]]] | None = None
    """Bytes of its wire of either direction, item by item with fields and problems, for people; None without words. It
    is given one datagram, a piece of a line, or a CAN frame as candump writes it, in ASCII: `201#C800`.
    """
    period: Callable[[KindSettings], float | None] = _not_known
    """Time between two frames with these settings, s; None where it is shorter than a cycle of any robot, or not known
    before the sensor streams.
    """
    bus: CanBus | None = None
    """Bus of a device on CAN: an interface with another rate cannot reach it."""
    also: str = ""
    """An older name under which `sensor.emulated` chooses it."""


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


_Kind = TypeVar("_Kind", RobotKind, SensorKind, SurfaceKind)


@dataclass(frozen=True, slots=True)
class Registry(Generic[_Kind]):
    """All kinds of one thing, ours and those of other packages. A room is imported when its kind is chosen."""

    thing: str
    group: str
    built_in: Mapping[str, str]
    """Module and attribute of our own, by name; the first is that of URLs without a kind."""
    type: type[_Kind]
    direct: tuple[str, ...] = ()
    """Names of those kinds whose `directly` is set: known without importing a room."""

    @property
    def names(self) -> Sequence[str]:
        """Names of all kinds, ours first."""
        return [*self.built_in, *(name for name in plugin_names(self.group) if name not in self.built_in)]

    def kind(self, name: str) -> _Kind:
        """The kind of a name. Raises ConfigError for a name that is not known, and for a package that is broken."""
        found = find_plugin(self.group, self.thing, name, self.built_in)
        if found is not None:
            if not (isinstance(found.value, self.type) and found.value.name == name):
                raise ConfigError(
                    f"{found.where}: {found.source} must be a {self.type.__name__} of that name"
                )
            if fault := fault_of(found.value, _SECTIONS):
                raise ConfigError(f"{found.where}: {found.source} cannot be used: {fault}")
            return found.value
        if name not in self.built_in:
            known = (
                f"choose one of {', '.join(self.names)}" if self.names else "no installed package offers one"
            )
            raise ConfigError(f"there is no {self.thing} {name!r}; {known}")
        module, _, attribute = self.built_in[name].partition(":")
        kind: _Kind = getattr(import_module(module), attribute)
        return kind

    def split(self, url: str) -> tuple[str, str]:
        """The kind that a URL names, and the wire's URL; "" where it names none."""
        name, plus, wire = url.partition("+")
        return (name, wire) if plus and name in self.names else ("", url)


@dataclass(frozen=True)
class CellSection(CellProfile):
    """Settings of every emulated cell, whatever its devices: the base of the section `[cell]`."""

    surface_kind: str = setting(
        "", Mark.CHOSEN, "kind of surface that another package offers; empty: ours, by [cell.surface]"
    )


_SECTIONS = frozenset(field.name for field in fields(CellSection))
"""Names in the section of the cell that no kind may have."""
ROBOTS = Registry("robot", "hil_bridge.robots", _ROBOTS, RobotKind, ("s3",))
SENSORS = Registry("sensor", "hil_bridge.sensors", _SENSORS, SensorKind, ("jr3", "jr3-uart", "jr3-board"))
SURFACES: Registry[SurfaceKind] = Registry("surface", "hil_bridge.surfaces", {}, SurfaceKind)


def usual_bus() -> CanBus:
    """The CAN bus of the first of our kinds that has one: what an interface is for that no sensor's URL names."""
    return next(kind.bus for kind in map(SENSORS.kind, SENSORS.direct) if kind.bus is not None)


def robot_of(url: str) -> tuple[RobotKind, str]:
    """The kind of robot that a URL names, and the wire's URL. Raises ConfigError."""
    name, wire = ROBOTS.split(url)
    if not name and "+" in url.partition(":")[0]:
        raise ConfigError(
            f"{url!r}: there is no robot {url.partition('+')[0]!r}; choose one of {', '.join(ROBOTS.names)}, as in "
            "KIND+WIRE"
        )
    return ROBOTS.kind(name or next(iter(_ROBOTS))), wire


def sensor_of(url: str) -> tuple[SensorKind, str]:
    """The kind of sensor that a URL names, and the wire's URL. Raises ConfigError."""
    for kind in map(SENSORS.kind, SENSORS.direct):
        if (wire := kind.older_form(url)) is not None:
            return kind, wire
    name, wire = SENSORS.split(url)
    if name:
        return SENSORS.kind(name), wire
    raise ConfigError(
        f"{url!r}: unknown scheme {url.partition(':')[0]!r}; allowed: can+… for a CAN gateway, a serial port with "
        f"?gateway=jr3 for a UART gateway, KIND+WIRE with one of the kinds {', '.join(SENSORS.names)}"
    )


def emulated_sensor(name: str) -> SensorKind:
    """The kind of sensor that a configuration emulates under this name, also an older one. Raises ConfigError."""
    for kind in map(SENSORS.kind, SENSORS.direct):
        if name == kind.also:
            return kind
    return SENSORS.kind(name)


Words: TypeAlias = Callable[[bytes], list[dict[str, object]]]


def words_of(kind: RobotKind | SensorKind) -> Words | None:
    """The words for a kind's bytes. Another package's may raise anything: that is a problem of the bytes, in words."""
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


def faults_of(robot: str, sensor: str, surface: str = "") -> Mapping[str, Mapping[str, Fault]]:
    """All faults of a cell with these emulated devices, by target and name. Raises ConfigError."""
    devices = ROBOTS.kind(robot).emulation, emulated_sensor(sensor).emulation
    own = dict(OWN_FAULTS)
    if surface:
        own["surface"] = SURFACES.kind(surface).faults
    return {**{on: faults for one in devices if one for on, faults in one.faults.items()}, **own}
