"""The composition root: which robot, which sensor, which surface and which wires are joined, by the kinds that a
configuration names.
"""

from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from emulators.cell import Cell, Parts
from emulators.panel import Controls, Panel
from emulators.seams import StartPose
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
from hil_bridge.errors.failures import WrongAnswer, one_line, plugin_place, report_failure
from hil_bridge.record import EventKind
from hil_bridge.runs.faults.bus import BusFaults
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.devices import Robot, Sensor
from hil_bridge.transports.can.memory import memory_can_bus
from protocol.geometry import Quaternion, Vector
from protocol.unmodelled import NotModelled

_MEMORY_CAN = "can+memory"


@dataclass(frozen=True, slots=True)
class ServedCell:
    """An emulated cell and its devices, with the URLs at which they are reached; None for a device not served."""

    cell: Cell[Any, Any]
    robot: Robot | None
    sensor: Sensor | None
    panel: str | None
    """URL of the emulated controller's panel, for operators."""
    operated: LocalPanel | None = None
    """The same panel for this process; None for a kind without one, and if no robot is served."""


@dataclass(frozen=True, slots=True)
class Devices:
    """Robot and sensor of a run, started, and the emulated cell if there is one."""

    robot: RobotLink
    sensor: ForceSensor
    served: ServedCell | None

    @property
    def cell(self) -> Cell[Any, Any] | None:
        """The emulated cell; None if both devices are real."""
        return None if self.served is None else self.served.cell


_Device = TypeVar("_Device", Robot, Sensor)


def choose_port(device: _Device, virtual: bool) -> _Device:
    """Return an emulated device with the URL at which it listens: its own, or the kind's default.

    Raises ConfigError.
    """
    return replace(device, url=device.url or _emulation(device.kind).usual(device.settings, virtual))


def check_panel(setup: Setup, virtual: bool) -> None:
    """Raise ConfigError for a panel where there is none, and for a URL that can be none."""
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
    """Raise ConfigError where the emulated robot of a kind has no panel, which an option asks for."""
    if _emulation(kind).controls is None:
        raise ConfigError(f"an emulated {kind.name} has no panel; leave {option} out")


def make_cell(setup: Setup, now: float) -> Cell[Any, Any]:
    """Make the emulated cell of a setup, powered up `now`, s. Raises ConfigError for an impossible one."""
    config, surface = setup.config, setup.cell_surface
    parts = Parts(
        _make(setup.cell_robot),
        _make(setup.cell_sensor),
        None if surface is None else surface[0].make(surface[1]),
        setup.emulated.faults,
    )
    try:
        return Cell(config.cell, now, config.run.seed, parts)
    except ValueError as error:
        place = plugin_place(error)
        raise ConfigError(f"cell: {one_line(str(error))}{place and f' ({place})'}") from error


def _make(device: Robot | Sensor) -> Any:
    return _emulation(device.kind).make(device.settings)


def can_hold(setup: Setup, place: Vector, quaternion: Quaternion | None = None) -> bool:
    """Whether the emulated robot can hold its tool there, base frame, m; None: in the orientation of the start."""
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
    """Robot and sensor of a configuration, started; what has no URL is emulated. Closed when the context is left.

    `wrap` may put something between each wire and its client; `cell` is the emulated cell where a check has made it
    already. Raises ConfigError for a URL, TransportUnavailable for
    a wire.
    """
    check_panel(setup, clock.is_virtual)
    robot_wiring, sensor_wiring = (Wiring(name, clock, log, wrap) for name in ("robot", "sensor"))
    async with AsyncExitStack() as stack:
        served, chosen_robot, chosen_sensor = None, setup.robot, setup.sensor
        if chosen_robot.is_emulated or chosen_sensor.is_emulated:
            emulated = emulated_cell(setup, clock, lambda cause: _tell_failed(cause, log), cell=cell)
            served = await stack.enter_async_context(emulated)
            chosen_robot, chosen_sensor = served.robot or chosen_robot, served.sensor or chosen_sensor
        robot = await connect_robot(chosen_robot, robot_wiring)
        stack.push_async_callback(robot.aclose)
        sensor = await connect_sensor(chosen_sensor, sensor_wiring)
        stack.push_async_callback(sensor.aclose)
        robot.start()
        sensor.start()
        yield Devices(robot, sensor, served)


def _tell_failed(cause: BaseException, log: DeviceLog) -> None:
    """Tell that an emulated device can no longer be served: its wire has ended, or its code has failed."""
    if isinstance(cause, BridgeError):
        log.notice(EventKind.EMULATOR, repr(cause))
        return
    report_failure("the emulated cell", cause, log.notice)


def follow_unmodelled(cell: Cell[Any, Any], listener: Callable[[NotModelled], object]) -> None:
    """Tell the listener each thing that a client uses and a device of the cell does not model, once."""
    for device in (cell.robot, cell.sensor):
        if isinstance(device, TaggingDevice):
            device.unmodelled.follow(listener)


async def connect_robot(robot: Robot, wiring: Wiring) -> RobotLink:
    """Connect the robot on its wire, without starting it.

    Raises ConfigError for the URL, TransportUnavailable for the wire.
    """
    link: RobotLink = await robot.kind.connect(robot.url, robot.settings, wiring)
    if robot.kind.name in ROBOTS.own:
        return link
    if not callable(getattr(link, "motion", None)):
        raise WrongAnswer(robot.kind, "connect", link, "a robot link")
    return wrap_plugin_link(link, robot.url, wiring.clock)


async def connect_sensor(sensor: Sensor, wiring: Wiring) -> ForceSensor:
    """Connect the sensor on its wire, without starting it: the kind names the device in between.

    Raises ConfigError for the URL, TransportUnavailable for the wire.
    """
    answer: Any = await sensor.kind.connect(sensor.url, sensor.settings, wiring)
    if not (isinstance(answer, tuple) and len(answer) == 2):
        raise WrongAnswer(sensor.kind, "connect", answer, "a wire and a client")
    wire, client = answer
    return ForceSensor(wire, client, wiring.clock, wiring.log)


@asynccontextmanager
async def _serve_panel(panel: LocalPanel, url: str, clock: Clock) -> AsyncIterator[str]:
    """Let the panel listen on a URL; where it is asked.

    Raises ConfigError for the URL, TransportUnavailable for the port.
    """
    server = PanelServer(panel.perform, clock)
    address = await server.listen(url)
    try:
        yield address
    finally:
        await server.aclose()


def _operate(cell: Cell[Any, Any], kind: str, controls: Controls, serving: Serving) -> LocalPanel:
    """Serve the panel of the cell's robot. Each act wakes the cell's devices."""
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
    """Serve the cell's devices where the setup lets them listen, until the context is left.

    `on_failure` is told when a device can no longer be served, `say` a line for every connection that ends badly.
    `cell` is the cell where it has been made already. Raises ConfigError for a URL and for a cell that cannot be,
    TransportUnavailable for a wire.
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
    wire_at = await _emulation(device.kind).serve(device.url, emulator, device.settings, serving)
    return replace(device, url=wire_at)


def _serve_bus_faults(sensor: Sensor, cell: Cell[Any, Any], serving: Serving, seed: int) -> None:
    """Let the sensor's CAN bus have faults, where it is one in memory."""
    wire = sensor.kind.parse(sensor.url, sensor.settings)
    if wire.scheme == _MEMORY_CAN:
        bus = BusFaults(memory_can_bus(wire.target, serving.clock), serving.clock, seed)
        cell.ledger.attach("bus", bus.handlers)
        serving.stack.callback(bus.close)


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
        """Return at once."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None


def _emulation(kind: Any) -> Any:
    """Emulation of a kind of device. Raises ConfigError for a kind without one."""
    emulation: RobotEmulation[Any, Any] | SensorEmulation[Any, Any] | None = kind.emulation
    if emulation is None:
        raise ConfigError(f"{kind.name} has no emulator; give the URL of a real one")
    return emulation
