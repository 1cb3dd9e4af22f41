"""The composition root: which robot, which sensor, which surface and which wires are joined, by the kinds that a
configuration names.
"""

from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from typing import Any

from emulators.cell import Cell, Parts
from emulators.seams import StartPose
from emulators.unmodelled import TaggingDevice
from hil_bridge.clock import VIRTUAL_EPOCH, Clock, Timer, device_clock
from hil_bridge.devices.device_log import DeviceLog
from hil_bridge.devices.kinds import (
    ROBOTS,
    DeviceKind,
    EmulatedKinds,
    RobotEmulation,
    SensorEmulation,
    robot_of,
    sensor_of,
)
from hil_bridge.devices.robots.of_others import link_of_others
from hil_bridge.devices.robots.seam import RobotLink
from hil_bridge.devices.sensors.stream import ForceSensor
from hil_bridge.devices.wiring import Serving, Wiring, Wrap, unwrapped
from hil_bridge.errors import BridgeError, ConfigError
from hil_bridge.errors.failures import WrongAnswer, one_line, plugin_place, tell_failure
from hil_bridge.runs.faults.bus import BusFaults
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.configuration import Config
from hil_bridge.settings.devices import emulated_in, robot_in, sensor_in
from hil_bridge.settings.kinds import settings_of, surface_settings
from hil_bridge.transports.can.memory import memory_can_bus
from protocol.geometry import Vector
from protocol.unmodelled import NotModelled

_MEMORY_CAN = "can+memory:"


@dataclass(frozen=True, slots=True)
class Ports:
    """One URL each for robot, sensor and panel of a cell to listen on; None for what is not served."""

    robot: str | None
    sensor: str | None
    panel: str | None = None
    """URL of the emulated controller's panel, for people."""
    cell: Cell[Any, Any] | None = None
    """The cell where it has been made already, of the kinds that the configuration names."""


@dataclass(frozen=True, slots=True)
class ServedCell:
    """An emulated cell, and the URLs at which its devices are reached; None for what is not served."""

    cell: Cell[Any, Any]
    robot: str | None
    sensor: str | None
    panel: str | None


@dataclass(frozen=True, slots=True)
class Devices:
    """Robot and sensor of a run, started, and the emulated cell if there is one."""

    robot: RobotLink
    sensor: ForceSensor
    served: ServedCell | None

    @property
    def cell(self) -> Cell[Any, Any] | None:
        """The emulated cell; None where both devices are real."""
        return None if self.served is None else self.served.cell


def cell_ports(config: Config, virtual: bool) -> Ports:
    """URLs at which the cell of a configuration listens, without a panel."""
    kinds = emulated_in(config)
    return Ports(_usual(config, kinds.robot, virtual), _usual(config, kinds.sensor, virtual))


def _usual(config: Config, kind: DeviceKind, virtual: bool) -> str:
    return f"{kind.name}+{_emulation(kind).usual(settings_of(config, kind), virtual)}"


def check_panel(setup: Setup, virtual: bool) -> None:
    """Raise ConfigError for a panel where there is none, and for a URL that can be none."""
    url, real = setup.config.run.panel_url, not setup.robot.is_emulated
    if not url:
        return
    if real or virtual:
        raise ConfigError(
            "run.panel_url (--panel) is the emulated controller's panel; leave it out "
            f"{'with a real robot' if real else 'in virtual time, where a person could not press in time'}"
        )
    check = _emulation(setup.robot.kind).check_panel
    if check is None:
        raise ConfigError(
            f"an emulated {setup.robot.kind.name} has no panel; leave run.panel_url (--panel) out"
        )
    check(url)


def make_cell(setup: Setup, kinds: EmulatedKinds, now: float) -> Cell[Any, Any]:
    """The emulated cell of a configuration with devices of these kinds. Raises ConfigError for one that cannot be."""
    config, surface = setup.config, kinds.surface
    parts = Parts(
        _emulation(kinds.robot).make(settings_of(config, kinds.robot)),
        _emulation(kinds.sensor).make(settings_of(config, kinds.sensor)),
        None if surface is None else surface.make(surface_settings(config, surface)),
        kinds.faults,
    )
    try:
        return Cell(config.cell, now, config.run.seed, parts)
    except ValueError as error:
        place = plugin_place(error)
        raise ConfigError(f"cell: {one_line(str(error))}{place and f' ({place})'}") from error


def holds(setup: Setup, place: Vector) -> bool:
    """Whether the emulated robot can hold its tool there in the orientation of the start; base frame, m."""
    config, kind = setup.config, setup.emulated.robot
    make = _emulation(kind).make(settings_of(config, kind))
    start = StartPose(place, config.cell.start_quaternion, config.cell.tool.length_mm * 1e-3)
    try:
        make(start, VIRTUAL_EPOCH, config.run.seed)
    except ValueError:
        return False
    return True


@asynccontextmanager
async def open_devices(
    setup: Setup, clock: Clock, log: DeviceLog, wrap: Wrap = unwrapped, cell: Cell[Any, Any] | None = None
) -> AsyncIterator[Devices]:
    """Robot and sensor of a configuration, started; what has no URL is emulated. Closed when the context is left.

    `wrap` may put something between each wire and its client; `cell` is the emulated cell where a check has made it
    already. Raises ConfigError for a URL, TransportUnavailable for
    a wire.
    """
    config = setup.config
    check_panel(setup, clock.is_virtual)
    robot_url, sensor_url = config.robot.url, config.sensor.url
    async with AsyncExitStack() as stack:
        served = None
        if not (robot_url and sensor_url):
            usual = Ports(*setup.listen) if setup.listen else cell_ports(config, clock.is_virtual)
            ports = Ports(
                None if robot_url else usual.robot,
                None if sensor_url else usual.sensor,
                config.run.panel_url or None,
                cell,
            )
            served = await stack.enter_async_context(
                emulated_cell(setup, clock, ports, lambda cause: _tell_failed(cause, log))
            )
            robot_url, sensor_url = robot_url or served.robot or "", sensor_url or served.sensor or ""
        robot = await connect_robot(config, robot_url, Wiring("robot", clock, log, wrap))
        stack.push_async_callback(robot.aclose)
        sensor = await connect_sensor(config, sensor_url, Wiring("sensor", clock, log, wrap))
        stack.push_async_callback(sensor.aclose)
        robot.start()
        sensor.start()
        yield Devices(robot, sensor, served)


def _tell_failed(cause: BaseException, log: DeviceLog) -> None:
    """Tell that an emulated device can no longer be served: its wire has ended, or its code has failed."""
    if isinstance(cause, BridgeError):
        log.notice("emulator", repr(cause))
        return
    tell_failure("the emulated cell", cause, log.notice)


def follow_unmodelled(cell: Cell[Any, Any], listener: Callable[[NotModelled], object]) -> None:
    """Tell the listener each thing that a client uses and a device of the cell does not model, once."""
    for device in (cell.robot, cell.sensor):
        if isinstance(device, TaggingDevice):
            device.unmodelled.follow(listener)


async def connect_robot(config: Config, url: str, wiring: Wiring) -> RobotLink:
    """The robot behind a URL, not started yet.

    Raises ConfigError for the URL, TransportUnavailable for the wire.
    """
    device = robot_in(config, url)
    robot: RobotLink = await device.kind.connect(device.url, device.settings, wiring)
    if device.kind.name in ROBOTS.built_in:
        return robot
    if not callable(getattr(robot, "motion", None)):
        raise WrongAnswer(device.kind, "connect", robot, "a robot link")
    return link_of_others(robot, device.url, wiring.clock)


async def connect_sensor(config: Config, url: str, wiring: Wiring) -> ForceSensor:
    """The sensor behind a URL, not started yet: the URL says which device stands between.

    Raises ConfigError for the URL, TransportUnavailable for the wire.
    """
    device = sensor_in(config, url)
    answer: Any = await device.kind.connect(device.url, device.settings, wiring)
    if not (isinstance(answer, tuple) and len(answer) == 2):
        raise WrongAnswer(device.kind, "connect", answer, "a wire and a client")
    wire, client = answer
    return ForceSensor(wire, client, wiring.clock, wiring.log)


@asynccontextmanager
async def emulated_cell(
    setup: Setup,
    clock: Clock,
    ports: Ports,
    on_failure: Callable[[BaseException], object],
    say: Callable[[str], None] = lambda text: None,
) -> AsyncIterator[ServedCell]:
    """Serve the cell's devices on the given listening URLs (None: not served) until the context is left.

    `on_failure` is told when a device can no longer be served, `say` a line for every connection that ends badly.
    Raises ConfigError for a URL and for a cell that cannot be, TransportUnavailable for a wire.
    """
    clock = device_clock(clock)
    kinds, config = setup.emulated, setup.config
    robot_url = sensor_url = ""
    if ports.robot is not None:
        robot, robot_url = robot_of(ports.robot)
        kinds = kinds._replace(robot=robot)
    if ports.sensor is not None:
        sensor, sensor_url = sensor_of(ports.sensor)
        kinds = kinds._replace(sensor=sensor)
    cell = ports.cell or make_cell(setup, kinds, clock.now())
    async with AsyncExitStack() as stack:
        serving = Serving(clock, stack, on_failure, say)
        _follow_faults(cell, serving)
        robot_at = sensor_at = panel_at = None
        if ports.robot is not None:
            emulation = _emulation(kinds.robot)
            wire_at = await emulation.serve(robot_url, cell.robot, settings_of(config, kinds.robot), serving)
            robot_at = f"{kinds.robot.name}+{wire_at}"
            if ports.panel is not None and emulation.panel is not None:
                panel = emulation.panel(cell, ports.panel, clock, serving.wake)
                panel_at = await stack.enter_async_context(panel)
        if ports.sensor is not None:
            serve = _emulation(kinds.sensor).serve
            wire_at = await serve(sensor_url, cell.sensor, settings_of(config, kinds.sensor), serving)
            sensor_at = f"{kinds.sensor.name}+{wire_at}"
            if wire_at.startswith(_MEMORY_CAN):
                name = wire_at.removeprefix(_MEMORY_CAN).partition("?")[0]
                bus = BusFaults(memory_can_bus(name, clock), clock, config.run.seed)
                cell.ledger.attach("bus", bus.handlers)
                stack.callback(bus.close)
        yield ServedCell(cell, robot_at, sensor_at, panel_at)


def _follow_faults(cell: Cell[Any, Any], serving: Serving) -> None:
    """Wake the devices when a fault begins or ends, and end faults at their times."""
    changes, stack = cell.ledger.on_change, serving.stack
    end = _FaultEnd(cell, serving.clock)
    stack.callback(changes.clear)
    stack.callback(end.cancel)
    changes.append(end.arm)
    changes.append(serving.wake)


class _FaultEnd:
    """Ends the faults of a cell at their times."""

    def __init__(self, cell: Cell[Any, Any], clock: Clock) -> None:
        self._ledger = cell.ledger
        self._clock = clock
        self._timer: Timer | None = None

    def arm(self) -> None:
        """Wait for the next end."""
        self.cancel()
        if (at := self._ledger.next_deadline()) is not None:
            self._timer = self._clock.call_at(at, lambda: self._ledger.handle_deadline(at))

    def cancel(self) -> None:
        """Wait for nothing."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None


def _emulation(kind: Any) -> Any:
    """Emulation of a kind of device. Raises ConfigError for a kind without one."""
    found: RobotEmulation[Any, Any] | SensorEmulation[Any, Any] | None = kind.emulation
    if found is None:
        raise ConfigError(f"{kind.name} has no emulator; give the URL of a real one")
    return found
