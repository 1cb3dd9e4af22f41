"""Connections that a program of the emulated controller opens from this process to a server, over TCP.

A program may come from any client, so only servers on this computer are allowed, unless the cell's settings allow
others.
"""

import asyncio
import ipaddress
from typing import Any

from emulators.devices.rtde import ProgramSocket, RtdeRobot, Server
from hil_bridge.devices.client_port import Hangup, HangupEndpoint
from hil_bridge.devices.wiring import Serving
from hil_bridge.errors import TransportError
from hil_bridge.transports import Transport
from hil_bridge.transports.pump import Pump
from hil_bridge.transports.serial.files import FileWire
from hil_bridge.transports.tcp import connect_tcp

OPENING_MAX = 16
"""Maximum number of simultaneous pending connections. Chosen."""
_NAME_LENGTH = 80
"""Maximum number of printed characters of a server name. Chosen."""


class ProgramWires:
    """Connections that the programs of one controller open."""

    def __init__(self, robot: RtdeRobot, serving: Serving) -> None:
        self._robot, self._serving = robot, serving
        self._tasks: set[asyncio.Task[None]] = set()
        self._wires: set[Transport[bytes]] = set()
        self._refused: set[str] = set()

    def offer(self) -> None:
        """Allow programs to open connections."""
        self._robot.controller.console.open_socket = self._open

    async def aclose(self) -> None:
        """Close all connections."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        for wire in list(self._wires):
            await wire.aclose()

    def _open(self, host: str, port: int) -> ProgramSocket | None:
        if not 0 < port < 65536 or len(self._tasks) >= OPENING_MAX:
            return None
        if self._robot.controller.profile.program_servers == "loopback" and not _is_loopback(host):
            self._refuse(host)
            return None
        server, inner = self._robot.connect_program(self._serving.clock.now())
        self._begin(self._connect(host, port, server, inner))
        return inner

    def _refuse(self, host: str) -> None:
        """Report each refused server once, because a program retries."""
        if host not in self._refused and len(self._refused) < OPENING_MAX:
            self._refused.add(host)
            self._serving.say(
                f"rtde: a program may not connect to {host[:_NAME_LENGTH]!r}, which is not on this computer; "
                "set cell.rtde.program_servers to any to allow it"
            )

    async def _connect(self, host: str, port: int, server: Server, inner: ProgramSocket) -> None:
        clock = self._serving.clock
        try:
            wire = await connect_tcp(host, port, clock, f"program to {host}:{port}")
        except (TransportError, UnicodeError):
            server.close(clock.now())
            return
        except asyncio.CancelledError:
            server.close(clock.now())
            raise
        self._wires.add(wire)
        pump: Pump[bytes, Hangup] = Pump(
            HangupEndpoint(server),
            wire,
            clock,
            lambda event: self._hang_up(server, wire),
            lambda cause: ended(cause),
        )

        def ended(cause: BaseException) -> None:
            server.close(clock.now())
            self._serving.pumps.remove(pump)
            self._begin(self._close(wire))
            if not isinstance(cause, TransportError):
                self._serving.on_failure(cause)

        inner.wake = pump.kick
        if isinstance(wire, FileWire):
            inner.hold = wire.hold
        inner.opened()
        self._serving.pumps.append(pump)
        pump.start()

    def _hang_up(self, server: Server, wire: Transport[bytes]) -> None:
        """Send the data that the program has queued, then close its connection."""
        rest = server.data_to_send(self._serving.clock.now())
        if rest:
            wire.send(rest)
        self._begin(self._close(wire))

    async def _close(self, wire: Transport[bytes]) -> None:
        self._wires.discard(wire)
        await wire.aclose()

    def _begin(self, work: Any) -> None:
        task = self._serving.clock.loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)


def _is_loopback(host: str) -> bool:
    """Return whether a server is on this computer. The only accepted host name is localhost, because the address of
    any other name may change.
    """
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
