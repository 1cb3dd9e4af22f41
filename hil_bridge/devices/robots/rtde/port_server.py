"""Ports of the emulated controller. Each port accepts any number of clients."""

from collections.abc import Callable
from contextlib import ExitStack

from emulators.devices.rtde import ProgramMessage, RtdeRobot, Server
from hil_bridge.clock import Timer
from hil_bridge.clock.realtime import gc_off
from hil_bridge.devices.client_port import Accept, ClientEndpoint
from hil_bridge.devices.robots.rtde.addresses import PORTS, Address, parse_address
from hil_bridge.devices.robots.rtde.program_wires import ProgramWires
from hil_bridge.devices.wiring import Serving
from hil_bridge.errors.failures import RAISED, raise_if_interrupt
from hil_bridge.transports import Transport
from hil_bridge.transports.serial.files import FileWire
from protocol.devices.rtde.states import SafetyMode
from protocol.devices.rtde.wires import Port

BEAT_S = 0.02
"""Time between two updates of a controller without clients, s. Chosen."""
STEPS = 20
"""Number of statements that are compiled at a time. Chosen: this takes approximately 0.4 ms."""


class _ErrorLog:
    """Listener that prints the errors of programs, one per line."""

    def __init__(self, say: Callable[[str], object]) -> None:
        self._say = say

    def hear(self, saying: ProgramMessage) -> None:
        if saying.line:
            self._say(f"rtde: a program failed: {saying}")

    def receive_safety_mode(self, mode: SafetyMode) -> None:
        """Ignore the safety mode, because the view and the panel show it."""


class _Client:
    """Controller's end of the connection of one client: a `ClientEndpoint`."""

    def __init__(self, robot: RtdeRobot, port: Port, server: Server) -> None:
        self._robot, self._port, self._server = robot, port, server
        self.receive, self.data_to_send, self.next_event = (
            server.receive,
            server.data_to_send,
            server.next_event,
        )
        self.next_deadline, self.handle_deadline = server.next_deadline, server.handle_deadline

    @property
    def closing(self) -> bool:
        return self._server.closing

    def close(self, now: float) -> None:
        self._robot.leave(self._port, self._server, now)


class Ports:
    """Listening ports of one controller."""

    def __init__(self, robot: RtdeRobot, serving: Serving) -> None:
        self._robot, self._serving = robot, serving
        self._compiling = serving.stack.enter_context(ExitStack())
        """Contexts that are active while a program is compiled."""
        serving.stack.push_async_callback(self._close)
        self._beat: Timer | None = None
        self._programs = ProgramWires(robot, serving)
        robot.controller.console.listeners.append(_ErrorLog(serving.say))

    async def listen(self, address: Address) -> str:
        """Listen on an address and return the URL for a client. Raises TransportUnavailable if a port cannot be
        opened.
        """
        if not self._serving.clock.is_virtual:
            self._keep_pace()
            self._robot.controller.player.uploads.spread = self._begin_to_compile
        if address.name:
            for port in PORTS:
                await self._serving.serve_clients(f"memory:{address.memory_name(port)}", self._acceptor(port))
            return f"memory:{address.name}"
        self._programs.offer()
        ports: dict[Port, int] = {}
        free = address.ports.get(Port.RTDE) == 0
        for port, usual in PORTS.items():
            numbers = (address.ports[port],) if port in address.ports else (0,) if free else usual
            for number in numbers:
                name = f"tcp-listen://{address.authority}:{number}"
                real = await self._serving.serve_clients(name, self._acceptor(port))
                ports.setdefault(port, int(real.rpartition(":")[2]))
        if ports == {port: usual[0] for port, usual in PORTS.items() if usual}:
            return f"tcp://{address.authority}"
        options = "&".join(f"{port}={number}" for port, number in ports.items() if port is not Port.RTDE)
        return f"tcp://{address.authority}:{ports[Port.RTDE]}?{options}"

    def _begin_to_compile(self) -> None:
        """Start compiling with garbage collection disabled, because the collector would traverse all nodes of a
        program repeatedly.
        """
        self._compiling.enter_context(gc_off())
        self._serving.clock.call_soon(self._compile)

    def _compile(self) -> None:
        """Compile part of the programs that clients have uploaded. The rest is compiled after all callbacks that
        have become due.

        The clock is not read here: its time would apply to all late deadlines, and their cycles would be skipped.
        """
        try:
            if all(self._robot.controller.player.uploads.step() for _ in range(STEPS)):
                self._serving.clock.call_soon(self._compile)
            else:
                self._compiling.close()
        except RAISED as error:
            raise_if_interrupt(error)
            self._serving.on_failure(error)

    def _keep_pace(self) -> None:
        """Run the controller's cycles while no client is connected, so that the next client does not have to wait
        for them.
        """
        clock = self._serving.clock
        now = clock.now()
        try:
            self._robot.controller.advance(now)
        except RAISED as error:
            raise_if_interrupt(error)
            self._serving.on_failure(error)
            return
        self._beat = clock.call_at(now + BEAT_S, self._keep_pace)

    def _acceptor(self, port: Port) -> Accept:
        return lambda wire, now: self._connect(port, wire, now)

    def _connect(self, port: Port, wire: Transport[bytes], now: float) -> ClientEndpoint | None:
        server = self._robot.connect(port, now)
        if server is not None and isinstance(wire, FileWire):
            server.spare(lambda: wire.queued > 0)
        return None if server is None else _Client(self._robot, port, server)

    async def _close(self) -> None:
        if self._beat is not None:
            self._beat.cancel()
        await self._programs.aclose()


async def serve(url: str, robot: RtdeRobot, serving: Serving) -> str:
    """Let a controller listen, and return the URL for its client. Raises ConfigError for an invalid URL,
    TransportUnavailable if a port cannot be opened.
    """
    return await Ports(robot, serving).listen(parse_address(url, "tcp-listen"))
