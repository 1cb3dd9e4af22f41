"""Wires of a control box: addresses of its ports, the client's wires, and the ports of the emulated one.

| URL | ports |
|---|---|
| `tcp://192.168.1.203` | 502 for commands, 30003 for real reports |
| `tcp://127.0.0.1:40000?real=40001` | both ports from the URL |
| `tcp-listen://127.0.0.1:502` | the emulated box at the ports of a real one: 502, 30000 to 30003 |
| `tcp-listen://127.0.0.1:0` | the emulated box at free ports |
| `memory:NAME` | in memory |
"""

from dataclasses import dataclass

from hil_bridge.devices.client_port import Accept
from hil_bridge.devices.wiring import Serving, Wiring
from hil_bridge.errors import ConfigError
from hil_bridge.transports import Transport
from hil_bridge.transports.urls import (
    CONNECT_BYTES,
    LISTEN_BYTES,
    WireUrl,
    parse_url,
    split_option,
    with_option,
)
from hil_xarm.cable import Server
from hil_xarm.force import ForceSensor
from hil_xarm.reports import NUMBERS, Port
from hil_xarm.robot import XarmRobot

OPTION = "real"
"""Option of a URL with the port of the real reports."""
CONNECT = {scheme: CONNECT_BYTES[scheme] for scheme in ("tcp", "memory")}
LISTEN = {scheme: LISTEN_BYTES[scheme] for scheme in ("tcp-listen", "memory")}


@dataclass(frozen=True, slots=True)
class Address:
    """Addresses of the two ports that a client uses."""

    command: WireUrl
    real: str
    """URL of the real reports."""


def parse_address(url: str) -> Address:
    """Parse the URL of a control box for a client. Raises ConfigError if it is invalid."""
    wire, text = split_option(url, OPTION)
    if text is not None and not (text.isascii() and text.isdigit() and 0 < int(text[:6]) < 65536):
        raise ConfigError(f"{url!r}: {OPTION} must be a port from 1 to 65535, got {text!r}")
    head, mark, options = wire.partition("?")
    if head.startswith("tcp:") and not head.rpartition(":")[2].isdigit():
        wire = f"{head}:{NUMBERS[Port.COMMAND]}{mark}{options}"
    parsed = parse_url(wire, CONNECT)
    if parsed.scheme == "memory":
        return Address(parsed, f"{_in_memory(parsed.target, Port.REAL)}{mark}{options}")
    host = _bracketed(parsed.host_port[0])
    return Address(parsed, f"tcp://{host}:{text or NUMBERS[Port.REAL]}{mark}{options}")


def _bracketed(host: str) -> str:
    """Return a host in the notation of a URL."""
    return f"[{host}]" if ":" in host else host


def _in_memory(name: str, port: Port) -> str:
    return f"memory:{name}" if port is Port.COMMAND else f"memory:{name}-{port}"


async def open_wires(url: str, wiring: Wiring) -> dict[Port, Transport[bytes]]:
    """Open the wires of a client. Raises ConfigError for an invalid URL, TransportUnavailable without a connection."""
    address = parse_address(url)
    command = await wiring.bytes(address.command.text)
    try:
        real = await wiring.bytes(address.real)
    except BaseException:
        await command.aclose()
        raise
    return {Port.REAL: real, Port.COMMAND: command}


class _Client:
    """Box's end of the connection of one client: a `ClientEndpoint`."""

    def __init__(self, robot: XarmRobot, port: Port, server: Server) -> None:
        self._robot, self._port, self._server = robot, port, server
        self.receive, self.data_to_send = server.receive, server.data_to_send
        self.next_event = server.next_event
        self.next_deadline, self.handle_deadline = server.next_deadline, server.handle_deadline

    @property
    def closing(self) -> bool:
        """Whether the box closes the connection."""
        return self._server.closing

    def close(self, now: float) -> None:
        """End the connection."""
        self._robot.leave(self._port, self._server, now)


async def serve_box(url: str, robot: XarmRobot, serving: Serving, sensor: ForceSensor | None = None) -> str:
    """Let an emulated control box listen, and return the URL for its client. With `sensor`, the clients are those of
    the force sensor. Raises ConfigError for an invalid URL, TransportUnavailable if a port cannot be opened.
    """
    parsed = parse_url(url, LISTEN)
    served = {
        port: await serving.serve_clients(_listening(parsed, port), _acceptor(robot, port, sensor))
        for port in Port
    }
    command, real = served[Port.COMMAND], served[Port.REAL]
    if parsed.scheme == "memory":
        return command
    number = real.rpartition(":")[2]
    return command if int(number) == NUMBERS[Port.REAL] else with_option(command, OPTION, number)


def _acceptor(robot: XarmRobot, port: Port, sensor: ForceSensor | None) -> Accept:
    def accept(wire: Transport[bytes], now: float) -> _Client | None:
        server = robot.connect(port, now, sensor)
        return None if server is None else _Client(robot, port, server)

    return accept


def _listening(parsed: WireUrl, port: Port) -> str:
    if parsed.scheme == "memory":
        return _in_memory(parsed.target, port)
    host, number = parsed.host_port
    if port is not Port.COMMAND:
        number = NUMBERS[port] if number == NUMBERS[Port.COMMAND] else 0
    return f"tcp-listen://{_bracketed(host)}:{number}"
