"""Composition root, which connects robot, sensor, surface and links by the kinds that a configuration names."""

from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from emulators.cell import Cell, Parts
from emulators.panel import Controls, Panel
from emulators.seams import SensorStiffness, StartPose
from emulators.unmodelled import TaggingDevice
from hil_bridge.clock import VIRTUAL_EPOCH, Clock, Timer, device_clock
from hil_bridge.devices.device_log import DeviceLog
from hil_bridge.devices.kinds import ROBOTS, RobotEmulation, SensorEmulation
from hil_bridge.devices.panel import LocalPanel, PanelServer, panel_address
from hil_bridge.devices.robots.plugin_link import wrap_plugin_link
from hil_bridge.devices.robots.seam import RobotLink
from hil_bridge.devices.sensors.stream import ForceSensor
from hil_bridge.devices.wiring import Serving, Wiring, Wrap, unwrapped
from hil_bridge.errors import BridgeError, ConfigError
from hil_bridge.errors.failures import WrongAnswer, one_line, plugin_location, report_failure
from hil_bridge.record import EventKind
from hil_bridge.runs.faults.bus import BusFaults
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.devices import Robot, Sensor
from hil_bridge.transports.can.memory import memory_can_bus
from hil_bridge.transports.urls import naming_kind
from protocol.geometry import Quaternion, Vector
from protocol.unmodelled import NotModelled

_MEMORY_CAN = "can+memory"


@dataclass(frozen=True, slots=True)
class ServedCell:
    """Emulated cell and its devices, with the URLs of the devices. A device that is not served is None."""

    cell: Cell[Any, Any]
    robot: Robot | None
    sensor: Sensor | None
    panel: str | None
    """URL of the emulated controller's panel, for operators."""
    operated: LocalPanel | None = None
    """Panel for use in this process; None if the kind has no panel, or if no robot is served."""


@dataclass(frozen=True, slots=True)
class Devices:
    """Started robot and sensor of a run, and the emulated cell if there is one."""

    robot: RobotLink
    sensor: ForceSensor
    served: ServedCell | None

    @property
    def cell(self) -> Cell[Any, Any] | None:
        """Emulated cell; None if both devices are real."""
        return None if self.served is None else self.served.cell


_Device = TypeVar("_Device", Robot, Sensor)


def choose_port(device: _Device, virtual: bool) -> _Device:
    """Return an emulated device with the URL at which it listens: its own URL, or the default of its kind.

    Raises ConfigError.
    """
    return replace(device, url=device.url or _emulation(device.kind).usual(device.settings, virtual))


def check_panel(setup: Setup, virtual: bool) -> None:
    """Raise ConfigError for the panel of a robot that has no panel, or for an invalid URL."""
    url, real = setup.config.run.panel_url, not setup.robot.is_emulated
    if not url:
        return
    if real or virtual:
        raise ConfigError(
            "run.panel_url (--panel) is the emulated controller's panel; leave it out "
            f"{'with a real robot' if real else 'in virtual time, where an operator could not press in time'}"
        )
    check_controls(setup.robot.kind, "run.panel_url (--panel)")
    panel_address(url)


def check_controls(kind: Any, option: str) -> None:
    """Raise ConfigError if an option requires the panel of an emulated robot that has none."""
    if _emulation(kind).controls is None:
        raise ConfigError(f"an emulated {kind.name} has no panel; leave {option} out")


def make_cell(setup: Setup, now: float) -> Cell[Any, Any]:
    """Return the emulated cell of a setup, powered up at `now`, s. Raises ConfigError for an invalid cell."""
    config, surface = setup.config, setup.cell_surface
    sensor = setup.cell_sensor.settings.emulated
    parts = Parts(
        _make(setup.cell_robot),
        _make(setup.cell_sensor),
        None if surface is None else surface[0].make(surface[1]),
        setup.emulated.faults,
        sensor if isinstance(sensor, SensorStiffness) else None,
    )
    try:
        return Cell(config.cell, now, config.run.seed, parts)
    except ValueError as error:
        place = plugin_location(error)
        raise ConfigError(f"cell: {one_line(str(error))}{place and f' ({place})'}") from error


def _make(device: Robot | Sensor) -> Any:
    return _emulation(device.kind).make(device.settings)


def can_hold(setup: Setup, place: Vector, quaternion: Quaternion | None = None) -> bool:
    """Return whether the emulated robot can hold its tool at a position, base frame, m. An orientation of None
    stands for the orientation at the start.
    """
    config = setup.config
    turned = quaternion or config.cell.start_quaternion
    start = StartPose(place, turned, config.cell.tool.length_mm * 1e-3)
    try:
        _make(setup.cell_robot)(start, VIRTUAL_EPOCH, config.run.seed)
    except ValueError:
        return False
    return True


@asynccontextmanager
async def open_devices(
    setup: Setup, clock: Clock, log: DeviceLog, wrap: Wrap = unwrapped, cell: Cell[Any, Any] | None = None
) -> AsyncIterator[Devices]:
    """Start the robot and sensor of a configuration, and emulate devices without a URL. They are closed on exit
    from the context.

    `wrap` may insert a layer between each connection and its client. `cell` is the emulated cell if a check has
    already created it. Raises ConfigError for an invalid URL, and TransportUnavailable if a connection fails.
    """
    check_panel(setup, clock.is_virtual)
    robot_wiring, sensor_wiring = (Wiring(name, clock, log, wrap) for name in ("robot", "sensor"))
    async with AsyncExitStack() as stack:
        served, chosen_robot, chosen_sensor = None, setup.robot, setup.sensor
        if chosen_robot.is_emulated or chosen_sensor.is_emulated:
            emulated = emulated_cell(setup, clock, lambda cause: _report_failed(cause, log), cell=cell)
            served = await stack.enter_async_context(emulated)
            chosen_robot, chosen_sensor = served.robot or chosen_robot, served.sensor or chosen_sensor
        robot = await connect_robot(chosen_robot, robot_wiring)
        stack.push_async_callback(robot.aclose)
        sensor = await connect_sensor(chosen_sensor, sensor_wiring)
        stack.push_async_callback(sensor.aclose)
        robot.start()
        sensor.start()
        yield Devices(robot, sensor, served)


def _report_failed(cause: BaseException, log: DeviceLog) -> None:
    """Report that an emulated device can no longer be served, because its connection has ended or its code has
    failed.
    """
    if isinstance(cause, BridgeError):
        log.notice(EventKind.EMULATOR, repr(cause))
        return
    report_failure("the emulated cell", cause, log.notice)


def follow_unmodelled(cell: Cell[Any, Any], listener: Callable[[NotModelled], object]) -> None:
    """Report each feature that a client uses and a device of the cell does not model, once per feature."""
    for device in (cell.robot, cell.sensor):
        if isinstance(device, TaggingDevice):
            device.unmodelled.follow(listener)


async def connect_robot(robot: Robot, wiring: Wiring) -> RobotLink:
    """Connect the robot without starting it.

    Raises ConfigError for an invalid URL, and TransportUnavailable if the connection fails.
    """
    with naming_kind(robot.kind.name):
        link: RobotLink = await robot.kind.connect(robot.url, robot.settings, wiring)
    if robot.kind.name in ROBOTS.own:
        return link
    if not callable(getattr(link, "motion", None)):
        raise WrongAnswer(robot.kind, "connect", link, "a robot link")
    return wrap_plugin_link(link, robot.url, wiring.clock)


async def connect_sensor(sensor: Sensor, wiring: Wiring) -> ForceSensor:
    """Connect the sensor without starting it. Its kind names the device in between.

    Raises ConfigError for an invalid URL, and TransportUnavailable if the connection fails.
    """
    with naming_kind(sensor.kind.name):
        answer: Any = await sensor.kind.connect(sensor.url, sensor.settings, wiring)
    if not (isinstance(answer, tuple) and len(answer) == 2):
        raise WrongAnswer(sensor.kind, "connect", answer, "a wire and a client")
    wire, client = answer
    return ForceSensor(wire, client, wiring.clock, wiring.log)


@asynccontextmanager
async def _serve_panel(panel: LocalPanel, url: str, clock: Clock) -> AsyncIterator[str]:
    """Serve the panel on a URL, if requested.

    Raises ConfigError for an invalid URL, and TransportUnavailable if the port is unavailable.
    """
    server = PanelServer(panel.perform, clock)
    address = await server.listen(url)
    try:
        yield address
    finally:
        await server.aclose()


def _operate(cell: Cell[Any, Any], kind: str, controls: Controls, serving: Serving) -> LocalPanel:
    """Serve the panel of the cell's robot. Each action wakes the devices of the cell."""
    panel = Panel(cell.robot, controls, cell.ledger)

    def perform(request: Mapping[str, Any]) -> Mapping[str, Any]:
        try:
            return panel.perform(request, serving.clock.now())
        except ValueError:
            raise
        except Exception as error:  # code of a plug-in
            raise ValueError(f"the panel of {kind} fails: {one_line(repr(error))}") from error
        finally:
            serving.wake()

    return LocalPanel(kind, perform)


@asynccontextmanager
async def emulated_cell(
    setup: Setup,
    clock: Clock,
    on_failure: Callable[[BaseException], object],
    say: Callable[[str], None] = lambda text: None,
    cell: Cell[Any, Any] | None = None,
) -> AsyncIterator[ServedCell]:
    """Serve the devices of the cell at the URLs of the setup until exit from the context.

    `on_failure` is called when a device can no longer be served, and `say` with one line for every connection that
    ends abnormally. `cell` is the cell if it has already been created. Raises ConfigError for an invalid URL or
    cell, and TransportUnavailable if a connection fails.
    """
    clock = device_clock(clock)
    cell = cell or make_cell(setup, clock.now())
    async with AsyncExitStack() as stack:
        serving = Serving(clock, stack, on_failure, say)
        _follow_faults(cell, serving)
        robot: Robot | None = None
        sensor: Sensor | None = None
        panel_at: str | None = None
        operated: LocalPanel | None = None
        if setup.listen.robot is not None:
            robot = await _serve(setup.cell_robot, cell.robot, serving)
            controls = _emulation(robot.kind).controls
            if controls is not None:
                operated = _operate(cell, robot.kind.name, controls, serving)
            if setup.listen.panel and operated is not None:
                panel_at = await stack.enter_async_context(_serve_panel(operated, setup.listen.panel, clock))
        if setup.listen.sensor is not None:
            sensor = await _serve(setup.cell_sensor, cell.sensor, serving)
            if sensor.kind.bus is not None:
                _serve_bus_faults(sensor, cell, serving, setup.config.run.seed)
        yield ServedCell(cell, robot, sensor, panel_at, operated)


async def _serve(device: _Device, emulator: Any, serving: Serving) -> _Device:
    """Serve the device at the URL that its client uses."""
    device = choose_port(device, serving.clock.is_virtual)
    with naming_kind(device.kind.name):
        wire_at = await _emulation(device.kind).serve(device.url, emulator, device.settings, serving)
    return replace(device, url=wire_at)


def _serve_bus_faults(sensor: Sensor, cell: Cell[Any, Any], serving: Serving, seed: int) -> None:
    """Support faults of the sensor's CAN bus if the bus is in memory."""
    wire = sensor.kind.parse(sensor.url, sensor.settings)
    if wire.scheme == _MEMORY_CAN:
        bus = BusFaults(memory_can_bus(wire.target, serving.clock), serving.clock, seed)
        cell.ledger.attach("bus", bus.handlers)
        serving.stack.callback(bus.close)


def _follow_faults(cell: Cell[Any, Any], serving: Serving) -> None:
    """Wake the devices when a fault begins or ends, and end faults at their scheduled times."""
    changes, stack = cell.ledger.on_change, serving.stack
    end = _FaultEnd(cell, serving.clock)
    stack.callback(changes.clear)
    stack.callback(end.cancel)
    changes.append(end.arm)
    changes.append(serving.wake)


class _FaultEnd:
    """Timer that ends the faults of an emulated cell."""

    def __init__(self, cell: Cell[Any, Any], clock: Clock) -> None:
        self._ledger = cell.ledger
        self._clock = clock
        self._timer: Timer | None = None

    def arm(self) -> None:
        """Wait for the next fault to end."""
        self.cancel()
        if (at := self._ledger.next_deadline()) is not None:
            self._timer = self._clock.call_at(at, lambda: self._ledger.handle_deadline(at))

    def cancel(self) -> None:
        """Cancel the timer."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None


def _emulation(kind: Any) -> Any:
    """Return the emulation of a kind of device. Raises ConfigError for a kind that has no emulation."""
    emulation: RobotEmulation[Any, Any] | SensorEmulation[Any, Any] | None = kind.emulation
    if emulation is None:
        raise ConfigError(f"{kind.name} has no emulator; give the URL of a real one")
    return emulation
