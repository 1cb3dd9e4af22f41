"""Ports of the emulated controller. Each port accepts any number of clients."""

import asyncio
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

from emulators.devices.rtde import ProgramMessage, RtdeRobot
from hil_bridge.clock import Timer
from hil_bridge.clock.realtime import gc_off
from hil_bridge.devices.robots.rtde.addresses import PORTS, Address, parse_address
from hil_bridge.devices.robots.rtde.program_wires import Hangup, HangupEndpoint, ProgramWires
from hil_bridge.devices.wiring import Serving
from hil_bridge.errors import TransportError
from hil_bridge.errors.failures import RAISED, raise_if_interrupt
from hil_bridge.transports import Transport
from hil_bridge.transports.memory import listen_memory_clients
from hil_bridge.transports.pump import Pump
from hil_bridge.transports.serial.files import FileWire
from hil_bridge.transports.tcp import listen_tcp_clients
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


class Ports:
    """Listening ports of one controller."""

    def __init__(self, robot: RtdeRobot, serving: Serving) -> None:
        self._robot, self._serving = robot, serving
        self._wires: set[Transport[bytes]] = set()
        self._closing: set[asyncio.Task[None]] = set()
        self._stops: list[Callable[[], None]] = []
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
                accept = self._acceptor(port)
                self._stops.append(
                    listen_memory_clients(address.memory_name(port), self._serving.clock, accept)
                )
            return f"memory:{address.name}"
        self._programs.offer()
        ports: dict[Port, int] = {}
        free = address.ports.get(Port.RTDE) == 0
        for port, usual in PORTS.items():
            numbers = (address.ports[port],) if port in address.ports else (0,) if free else usual
            for number in numbers:
                name = f"tcp-listen://{address.authority}:{number}"
                stop, _, real = await listen_tcp_clients(
                    address.host, number, self._serving.clock, name, self._acceptor(port)
                )
                self._stops.append(stop)
                ports.setdefault(port, real)
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

    def _acceptor(self, port: Port) -> Callable[[Transport[bytes]], None]:
        return lambda wire: self._welcome(port, wire)

    def _welcome(self, port: Port, wire: Transport[bytes]) -> None:
        clock = self._serving.clock
        server = self._robot.connect(port, clock.now())
        self._wires.add(wire)
        if server is None:
            wire.start(_ignore, _ignore)
            self._hang_up(wire)
            return
        if isinstance(wire, FileWire):
            server.spare(lambda: wire.queued > 0)

        def ended(cause: BaseException) -> None:
            self._robot.leave(port, server, clock.now())
            self._serving.pumps.remove(pump)
            self._hang_up(wire)
            if not isinstance(cause, TransportError):
                self._serving.on_failure(cause)

        def hang_up(event: Any) -> None:
            rest = server.data_to_send(clock.now())
            if rest:
                wire.send(rest)
            self._hang_up(wire)

        pump: Pump[bytes, Hangup] = Pump(HangupEndpoint(server), wire, clock, hang_up, ended)
        self._serving.pumps.append(pump)
        pump.start()

    def _hang_up(self, wire: Transport[bytes]) -> None:
        """Close a wire without waiting."""
        self._wires.discard(wire)
        task = self._serving.clock.loop.create_task(wire.aclose())
        self._closing.add(task)
        task.add_done_callback(self._closing.discard)

    async def _close(self) -> None:
        if self._beat is not None:
            self._beat.cancel()
        for stop in self._stops:
            stop()
        for wire in list(self._wires):
            await wire.aclose()
        await self._programs.aclose()
        await asyncio.gather(*self._closing)


def _ignore(event: object) -> None:
    """Ignore data from a connection that is closed at once."""


async def serve(url: str, robot: RtdeRobot, serving: Serving) -> str:
    """Let a controller listen, and return the URL for its client. Raises ConfigError for an invalid URL,
    TransportUnavailable if a port cannot be opened.
    """
    return await Ports(robot, serving).listen(parse_address(url, "tcp-listen"))
