"""The composition root: which wire, which device and which emulator are joined. No other module knows both sides."""

from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from emulators.cell_faults import CELL_FAULTS
from emulators.faults import Ledger
from emulators.jr3 import Board
from emulators.s3 import EMPTY_SITE, Panel, S3Site
from emulators.s3_jr3_cell import PaperCell, PaperCellProfile, Receiver, s3_jr3_cell
from emulators.wires.slcan_adapter import SlcanAdapter, SlcanProfile
from hil_bridge.faults.bus import BusFaults
from hil_bridge.clock import Clock, Timer, device_clock
from hil_bridge.settings.configuration import Config, SensorConfig
from hil_bridge.sensors.stream import ForceSensor
from hil_bridge.robots.s3.link import RobotLink
from hil_bridge.errors import ConfigError, TransportClosed, TransportError
from hil_bridge.robots.s3.orders_file import read_orders
from hil_bridge.robots.s3.panel import PanelServer, panel_address
from hil_bridge.robots.s3.program_folder import read_programs
from hil_bridge.transports.pump import Pump
from hil_bridge.sensors.jr3.registers import BOARD, ListenerProfile, connect_board, serve_board
from hil_bridge.transports import (
    Direction,
    Frames,
    LineSettings,
    Parity,
    Tap,
    Transport,
    connect_bytes,
    connect_can,
    listen_bytes,
    listen_can,
)
from hil_bridge.transports.can.memory import memory_can_bus
from hil_bridge.transports.urls import CONNECT_BYTES, LISTEN_BYTES, SERIAL_PORTS, parse_url, with_line
from protocol.s3.adlp import LinkProfile
from protocol.s3.arap import KNOWN, OrderBook
from protocol.jr3 import (
    GATEWAY_BITRATE,
    UART_BAUDRATE,
    GatewayClient,
    SensorClient,
    SensorFrame,
    UartGatewayClient,
    heard_by_client,
    heard_by_gateway,
)
from protocol.jr3.registers import BoardClient

_MEMORY_CAN = "can+memory:"
SLCAN = "can+slcan+"
"""Before a listening byte URL: an emulated slcan adapter on that wire."""


_UART_GATEWAY = "gateway=jr3"
"""Option of a sensor URL that is a byte wire: a JR3 UART gateway is at its other end."""


@dataclass(frozen=True, slots=True)
class Ports:
    """One URL each for robot, sensor and panel, to listen on or to connect to; None for what is not served."""

    robot: str | None
    sensor: str | None
    panel: str | None = None
    """Of the emulated controller, for people."""


_REAL_SENSORS = {
    "gateway": f"{SLCAN}pty:",
    "uart": f"pty:?{_UART_GATEWAY}",
    "board": f"{BOARD}tcp-listen://127.0.0.1:0",
}
_VIRTUAL_SENSORS = {
    "gateway": "can+memory:sensor",
    "uart": f"memory:sensor?{_UART_GATEWAY}",
    "board": f"{BOARD}memory:sensor",
}
"""Where the emulated sensor listens, by `sensor.emulated`."""


def cell_ports(config: Config, virtual: bool) -> Ports:
    """Where the cell of a configuration listens, with no panel. In real time the robot has a line as the real one's,
    and a CAN gateway an slcan adapter.
    """
    if virtual:
        return Ports("memory:robot", _VIRTUAL_SENSORS[config.sensor.emulated])
    return Ports(with_line("pty:", _line(config.cell.link)), _REAL_SENSORS[config.sensor.emulated])


def robot_wire(url: str, link: LinkProfile) -> tuple[str, LinkProfile]:
    """A robot URL with what it leaves out of its serial line taken from the profile, and the profile with what
    the URL says of the line. Raises ConfigError.
    """
    parsed = parse_url(url, CONNECT_BYTES)
    options = parsed.options
    try:
        link = replace(
            link,
            baudrate=options.get("baudrate", link.baudrate),
            parity=Parity(options.get("parity", link.parity)).value,
            stop_bits=options.get("stopbits", link.stop_bits),
        )
    except ValueError as error:
        raise ConfigError(f"{url!r}: {error}") from error
    return (with_line(url, _line(link)) if parsed.scheme in SERIAL_PORTS else url), link


def _line(link: LinkProfile) -> LineSettings:
    return LineSettings(link.baudrate, Parity(link.parity), link.stop_bits)


def robot_site(config: Config) -> S3Site:
    """What the files of a configuration say of the robot controller's orders and programs. Raises ConfigError."""
    orders, programs = config.robot.orders_file, config.cell.robot.program_folder
    return S3Site(
        read_orders(Path(orders), config.robot.link.max_telegram) if orders else KNOWN,
        read_programs(Path(programs), config.cell.link.max_telegram) if programs else {},
    )


async def connect_robot(
    url: str,
    link: LinkProfile,
    clock: Clock,
    on_notice: Callable[[str, str], None],
    orders: OrderBook = KNOWN,
    on_traffic: Callable[[Direction, bytes], object] | None = None,
    on_link_event: Callable[[str], object] | None = None,
) -> RobotLink:
    """The robot behind a URL, not started yet; `on_traffic` is shown every byte both ways, `on_link_event` is told
    what the link makes of them.

    Raises ConfigError for the URL, TransportUnavailable for the wire.
    """
    url, link = robot_wire(url, link)
    wire = await connect_bytes(url, clock, on_notice)
    tapped = wire if on_traffic is None else Tap(wire, on_traffic)
    return RobotLink(tapped, link, clock, on_notice, orders, on_link_event)


def uart_wire(url: str, schemes: Mapping[str, Any]) -> str | None:
    """The byte wire of a sensor URL that names a UART gateway, `?gateway=jr3`; None for every other URL.

    A wire that can be paced or set gets the gateway's line, 115200 baud 8N1, where the URL says nothing else.
    `schemes` are those of the URL's side. Raises ConfigError for another gateway.
    """
    head, _, query = url.partition("?")
    options = [option for option in query.split("&") if option]
    named = [option for option in options if option.partition("=")[0] == "gateway"]
    scheme = head.partition(":")[0]
    if not named or scheme.startswith("can+"):
        return None
    if named != [_UART_GATEWAY]:
        raise ConfigError(f"{url!r}: gateway must be jr3, and once, got {'&'.join(named)!r}")
    options.remove(_UART_GATEWAY)
    if (known := schemes.get(scheme)) is not None and "baudrate" in known.options:
        given = any(option.startswith("baudrate=") for option in options)
        options = options if given else [f"baudrate={UART_BAUDRATE}", *options]
    return f"{head}?{'&'.join(options)}" if options else head


def sensor_kind(sensor: SensorConfig) -> str:
    """What stands before the sensor, as `sensor.emulated` names it: by the scheme of its URL, if it has one."""
    if not sensor.url:
        return sensor.emulated
    if sensor.url.startswith(BOARD):
        return "board"
    return "gateway" if uart_wire(sensor.url, CONNECT_BYTES) is None else "uart"


def _check_can(url: str) -> None:
    """Say what sensors there are where a URL names none. Raises ConfigError."""
    if not url.startswith("can+"):
        raise ConfigError(
            f"{url!r}: unknown scheme {url.partition(':')[0]!r}; allowed: can+… for a CAN gateway, a serial port with "
            "?gateway=jr3 for a UART gateway, jr3+tcp… for a receiver board"
        )


async def connect_sensor(
    url: str,
    sensor: SensorConfig,
    clock: Clock,
    on_frame: Callable[[SensorFrame], None],
    on_notice: Callable[[str, str], None],
    on_traffic: Callable[[Direction, Any], object] | None = None,
) -> ForceSensor:
    """The sensor behind a URL, not started yet: the URL's scheme says which device stands between. `on_traffic` is
    shown the bytes or CAN frames of its wire both ways.

    Raises ConfigError for the URL, TransportUnavailable for the wire.
    """
    wire: Transport[Any]
    client: SensorClient[Any]
    if url.startswith(BOARD):
        wire, board = await connect_board(url, sensor.board, clock)
        client = BoardClient(board, clock.now())
    elif (line := uart_wire(url, CONNECT_BYTES)) is not None:
        wire = await connect_bytes(line, clock, on_notice)
        client = UartGatewayClient(sensor.uart, clock.now())
    else:
        _check_can(url)
        wire = await connect_can(url, clock, heard_by_client(sensor.gateway.node))
        client = GatewayClient(sensor.gateway, clock.now())
    tapped = wire if on_traffic is None else Tap[Any](wire, on_traffic)
    return ForceSensor(tapped, client, clock, on_frame, on_notice)


def check_panel(config: Config, virtual: bool) -> None:
    """Raise ConfigError for a panel where there is none, and for a URL that can be none."""
    if not config.run.panel_url:
        return
    if config.robot.url or virtual:
        raise ConfigError(
            "run.panel_url (--panel) is the emulated controller's panel; leave it out "
            f"{'with a real robot' if config.robot.url else 'in virtual time, where nobody could press in time'}"
        )
    panel_address(config.run.panel_url)


@asynccontextmanager
async def opened_devices(
    config: Config,
    clock: Clock,
    on_frame: Callable[[SensorFrame], None],
    on_notice: Callable[[str, str], None],
    on_traffic: Callable[[Direction, bytes], object] | None = None,
    on_cell: Callable[[PaperCell], object] | None = None,
    on_panel: Callable[[str], object] | None = None,
    on_link_event: Callable[[str], object] | None = None,
    on_sensor_traffic: Callable[[Direction, Any], object] | None = None,
) -> AsyncIterator[tuple[RobotLink, ForceSensor]]:
    """Robot and sensor of a configuration, started; what has no URL is emulated. Closed when the context is left.
    `on_traffic` is shown the bytes of the robot's link, `on_link_event` told what it makes of them, `on_cell` is
    shown the emulated cell if there is one, `on_panel` told the URL of its panel, `on_sensor_traffic` shown the bytes
    or CAN frames of the sensor's wire.

    Raises ConfigError for a URL, TransportUnavailable for a wire.
    """
    check_panel(config, clock.is_virtual)
    robot_url, sensor_url, panel_url = config.robot.url, config.sensor.url, config.run.panel_url
    site = robot_site(config)
    async with AsyncExitStack() as stack:
        if not (robot_url and sensor_url):
            ports = cell_ports(config, clock.is_virtual)
            served = await stack.enter_async_context(
                emulated_cell(
                    config.cell,
                    config.run.seed,
                    clock,
                    Ports(
                        None if robot_url else ports.robot,
                        None if sensor_url else ports.sensor,
                        panel_url or None,
                    ),
                    lambda cause: on_notice("emulator", repr(cause)),
                    site,
                    on_cell,
                    filter_number=config.sensor.board.filter,
                )
            )
            robot_url, sensor_url = robot_url or served.robot or "", sensor_url or served.sensor or ""
            if on_panel is not None and served.panel is not None:
                on_panel(served.panel)
        robot = await connect_robot(
            robot_url, config.robot.link, clock, on_notice, site.orders, on_traffic, on_link_event
        )
        stack.push_async_callback(robot.aclose)
        sensor = await connect_sensor(
            sensor_url, config.sensor, clock, on_frame, on_notice, on_sensor_traffic
        )
        stack.push_async_callback(sensor.aclose)
        robot.start()
        sensor.start()
        yield robot, sensor


class SlcanPort:
    """The emulated adapter between a byte wire and its CAN side: a transport of frames for the gateway."""

    def __init__(self, serial: Transport[bytes], clock: Clock) -> None:
        self._serial = serial
        self._clock = clock
        self._adapter = SlcanAdapter(SlcanProfile())
        self._on_frames: Callable[[Frames], None] = lambda frames: None

    @property
    def name(self) -> str:
        """The URL of the byte wire."""
        return self._serial.name

    def start(self, on_data: Callable[[Frames], None], on_end: Callable[[TransportError], None]) -> None:
        """Begin to serve the host that talks to the adapter."""
        self._on_frames = on_data
        self._serial.start(self._from_host, on_end)

    def send(self, data: Frames) -> None:
        """Frames seen on the adapter's bus, for the host if its channel is open."""
        self._adapter.send_frames(data, self._clock.now())
        self._answer()

    async def aclose(self) -> None:
        """Close the byte wire."""
        await self._serial.aclose()

    def _from_host(self, data: bytes) -> None:
        self._adapter.receive(data, self._clock.now())
        self._answer()
        frames = []
        while (frame := self._adapter.next_event()) is not None:
            frames.append(frame)
        if frames:
            self._on_frames(frames)

    def _answer(self) -> None:
        if text := self._adapter.data_to_send(self._clock.now()):
            self._serial.send(text)


@asynccontextmanager
async def emulated_cell(
    profile: PaperCellProfile,
    seed: int,
    clock: Clock,
    ports: Ports,
    on_failure: Callable[[BaseException], None],
    site: S3Site = EMPTY_SITE,
    on_cell: Callable[[PaperCell], object] | None = None,
    on_log: Callable[[str], None] | None = None,
    filter_number: int = 0,
) -> AsyncIterator[Ports]:
    """Serve the cell's devices on the given listening URLs (None: not served) until the context is left.

    `on_failure` is told when a device can no longer be served. `site` is what the robot controller holds. `on_cell`
    is given the cell before anybody speaks to it, `on_log` a line for every connection to it that ends badly.
    `filter_number` is the filter of a receiver board that the client reads, for the ground truth. Raises ConfigError
    for a URL and for a cell that cannot be, TransportUnavailable for a wire.
    """
    clock = device_clock(clock)
    try:
        cell = s3_jr3_cell(profile, clock.now(), seed, site, _receiver(ports.sensor, filter_number))
    except ValueError as error:
        raise ConfigError(f"cell: {error}") from error
    if on_cell is not None:
        on_cell(cell)
    async with AsyncExitStack() as stack:
        changes = cell.ledger.on_change
        stack.callback(changes.clear)
        end = _FaultEnd(cell.ledger, clock)
        stack.callback(end.cancel)
        changes.append(end.arm)

        def ended(cause: BaseException) -> None:
            if not isinstance(cause, TransportClosed):
                on_failure(cause)

        def attach(endpoint: Any, transport: Transport[Any]) -> Pump[Any, Any]:
            stack.push_async_callback(transport.aclose)
            pump = Pump(endpoint, transport, clock, _nothing, ended)
            pump.start()
            changes.append(pump.kick)
            return pump

        robot = sensor = panel = None
        if ports.robot is not None:
            url, line = ports.robot, _line(profile.link)
            # a port in memory that names no line has the controller's, which its address does not tell
            unnamed = url.startswith("memory:") and "?" not in url
            bytes_at = await listen_bytes(with_line(url, line) if unnamed else url, clock)
            robot = with_line(bytes_at.address, line) if unnamed else bytes_at.address
            pump = attach(cell.robot.endpoint, bytes_at.transport)
            if ports.panel is not None:
                panel = await stack.enter_async_context(_panel(cell, ports.panel, clock, pump.kick))
        uart = None if ports.sensor is None else uart_wire(ports.sensor, LISTEN_BYTES)
        if ports.sensor is not None and isinstance(cell.sensor, Board):
            served = await serve_board(
                ports.sensor, cell.sensor.endpoint, ListenerProfile(), clock, on_log or _nothing, ended
            )
            stack.push_async_callback(served.aclose)
            sensor = served.address
        elif uart is not None:
            bytes_at = await listen_bytes(uart, clock)
            attach(cell.sensor.endpoint, bytes_at.transport)
            sensor = bytes_at.address + ("&" if "?" in bytes_at.address else "?") + _UART_GATEWAY
        elif ports.sensor is not None and ports.sensor.startswith(SLCAN):
            if not ports.sensor.startswith(f"{SLCAN}pty:"):
                raise ConfigError(
                    f"{ports.sensor!r}: an slcan adapter is a serial port; for example {SLCAN}pty:"
                )
            bytes_at = await listen_bytes(ports.sensor.removeprefix(SLCAN), clock)
            attach(cell.sensor.endpoint, SlcanPort(bytes_at.transport, clock))
            sensor = slcan_address(bytes_at.address)
        elif ports.sensor is not None:
            _check_can(ports.sensor)
            frames_at = await listen_can(ports.sensor, clock, heard_by_gateway(profile.gateway.node))
            attach(cell.sensor.endpoint, frames_at.transport)
            sensor = frames_at.address
            if sensor.startswith(_MEMORY_CAN):
                bus = BusFaults(memory_can_bus(sensor.removeprefix(_MEMORY_CAN), clock), clock, seed)
                cell.ledger.attach("bus", bus.handlers)
                stack.callback(bus.close)
        yield Ports(robot, sensor, panel)


def _receiver(url: str | None, filter_number: int) -> Receiver:
    """Which device reads the sensor out that listens on this URL; None is for a sensor that is not served."""
    if url is not None and url.startswith(BOARD):
        return Receiver("board", filter_number)
    return Receiver("gateway" if url is None or uart_wire(url, LISTEN_BYTES) is None else "uart")


class _FaultEnd:
    """Ends the faults of a cell at their times."""

    def __init__(self, ledger: Ledger, clock: Clock) -> None:
        self._ledger = ledger
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


def slcan_address(port: str) -> str:
    """The CAN URL of an emulated adapter on a pseudo-terminal, with the rate of its line if it has one."""
    found = parse_url(port, CONNECT_BYTES)
    rate = found.options.get("baudrate")
    return f"can+slcan://{found.target}?bitrate={GATEWAY_BITRATE}{f'&tty_baudrate={rate}' if rate else ''}"


@asynccontextmanager
async def _panel(cell: PaperCell, url: str, clock: Clock, kick: Callable[[], None]) -> AsyncIterator[str]:
    """The panel of the cell's controller on a listening URL; where it is asked. `kick` wakes the controller."""
    board = Panel(cell.robot, cell.ledger, CELL_FAULTS)

    def perform(request: Mapping[str, Any]) -> Mapping[str, Any]:
        try:
            return board.perform(request, clock.now())
        finally:
            kick()

    server = PanelServer(perform, clock)
    address = await server.listen(url)
    try:
        yield address
    finally:
        await server.aclose()


def _nothing(event: object) -> None:
    """A device keeps to its wire: nobody beside it is told what happened."""
