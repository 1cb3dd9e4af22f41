"""Connections that a program of the emulated controller opens, over TCP on this computer."""

import asyncio
import socket
import struct
from collections.abc import Awaitable, Callable
from contextlib import AsyncExitStack
from dataclasses import dataclass, field

from emulators.devices.rtde import RtdeProfile, RtdeRobot
from emulators.devices.rtde.program_socket import UNREAD_MAX
from emulators.seams import StartPose
from hil_bridge.clock import Clock
from hil_bridge.devices.robots.rtde import port_server as ports
from hil_bridge.devices.wiring import Serving
from protocol.devices.rtde.states import Runtime
from protocol.devices.rtde.wires import Port

START = StartPose((0.9, -0.1, 0.6), (0.0, 1.0, 0.0, 0.0), 0.2)
ECHO = """def echo():
  if socket_open("%s", %d, "pc"):
    socket_send_line("here", "pc")
    given = socket_read_binary_integer(2, "pc", 0)
    socket_send_int(given[1] + given[2], "pc")
  else:
    textmsg("nothing there")
  end
end
"""


@dataclass
class Site:
    """Controller on its own ports, and a server for its programs."""

    robot: RtdeRobot
    port: int
    clients: list[tuple[asyncio.StreamReader, asyncio.StreamWriter]] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)

    def play(self, host: str, port: int) -> None:
        robot = self.robot
        server = robot.connect(Port.SCRIPT, robot.controller.now)
        assert server is not None
        server.receive((ECHO % (host, port)).encode(), robot.controller.now)

    async def until(self, condition: Callable[[], bool], drives: bool = True) -> None:
        async with asyncio.timeout(30):
            while not condition():
                await asyncio.sleep(0.005)
                if drives:
                    self.robot.controller.advance(Clock.running().now())

    def messages(self) -> list[str]:
        return [str(saying) for saying in self.robot.controller.console.program_messages]


def at_site(act: Callable[[Site], Awaitable[None]], **profile: str) -> None:
    async def run() -> None:
        clock = Clock.running()
        robot = RtdeRobot(RtdeProfile(start_delay_ms=0.0, **profile), START, clock.now(), 7)  # type: ignore[arg-type]
        site = Site(robot, 0)
        server = await asyncio.start_server(lambda *both: site.clients.append(both), "127.0.0.1", 0)
        site.port = server.sockets[0].getsockname()[1]
        failures: list[BaseException] = []
        async with AsyncExitStack() as stack:
            await ports.serve(
                "tcp-listen://127.0.0.1:0", robot, Serving(clock, stack, failures.append, site.lines.append)
            )
            await act(site)
        for reader, writer in site.clients:
            async with asyncio.timeout(10):
                await reader.read()  # to its end: the controller closed it when it ended
            writer.close()
        server.close()
        assert not failures

    asyncio.run(run())


def test_program_connects_to_local_server() -> None:
    async def act(site: Site) -> None:
        site.play("127.0.0.1", site.port)
        await site.until(lambda: bool(site.clients))
        reader, writer = site.clients[0]
        await site.until(lambda: site.robot.controller.player.runtime == Runtime.PLAYING)
        async with asyncio.timeout(30):  # from here on only the connection drives the controller
            assert await reader.readline() == b"here\n"
            writer.write(struct.pack(">2i", 40, 2))
            assert struct.unpack(">i", await reader.readexactly(4)) == (42,)
            assert await reader.read() == b"", "the connection ends with the program"
        assert site.lines == []

    at_site(act)


def test_program_wire_flooding_server_is_throttled() -> None:
    """The server sends four times the buffer of a program that does not read."""
    count = 4 * UNREAD_MAX // 4096
    text = (
        f'def reader():\n  socket_open("127.0.0.1", %d, "pc")\n  sleep(0.2)\n  n = 0\n  while n < {count}:\n'
        '    given = socket_read_byte_list(4096, "pc", 0)\n    n = n + given[0] / 4096\n  end\n'
        '  socket_send_line("all", "pc")\nend\n'
    )

    async def act(site: Site) -> None:
        script = site.robot.connect(Port.SCRIPT, site.robot.controller.now)
        assert script is not None
        script.receive((text % site.port).encode(), site.robot.controller.now)
        await site.until(lambda: bool(site.clients))
        reader, writer = site.clients[0]
        writer.write(bytes(4096 * count))
        async with asyncio.timeout(30):
            assert await reader.readline() == b"all\n"
        assert site.robot.controller.counts["sockets of programs closed, too much unread"] == 0

    at_site(act)


def test_program_wire_missing_server_is_reported_to_program() -> None:
    async def act(site: Site) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            site.play("localhost", free.getsockname()[1])
            await site.until(lambda: "nothing there" in site.messages())
        assert site.lines == []

    at_site(act)


def test_program_wire_to_other_computer_is_refused_once() -> None:
    async def act(site: Site) -> None:
        site.play("192.0.2.1", 50001)  # an address reserved for documentation
        await site.until(lambda: "nothing there" in site.messages())
        site.play("192.0.2.1", 50001)
        await site.until(lambda: site.messages().count("nothing there") == 2)
        (line,) = site.lines
        assert line.startswith("rtde: a program may not connect to '192.0.2.1'")
        assert "cell.rtde.program_servers" in line

    at_site(act)


def test_program_continues_after_client_disconnects() -> None:
    """Then only the clock drives the controller."""

    async def act(site: Site) -> None:
        text = b"def alone():\n  sleep(0.1)\n  write_output_integer_register(1, 7)\nend\n"
        script = site.robot.connect(Port.SCRIPT, site.robot.controller.now)
        assert script is not None
        script.receive(text, site.robot.controller.now)
        controller = site.robot.controller
        await site.until(lambda: controller.io.outputs.get("output_int_register_1") == 7, drives=False)

    at_site(act)


def test_program_wire_is_closed_with_controller() -> None:
    """`at_site` reads every connection to its end after the controller has ended."""

    async def act(site: Site) -> None:
        site.play("127.0.0.1", site.port)
        await site.until(lambda: bool(site.clients))

    at_site(act)
