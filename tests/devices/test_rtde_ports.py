"""The emulated controller's ports in memory: many clients, clients that leave, do not read, or are one too many."""

from collections.abc import Awaitable, Callable
from contextlib import AsyncExitStack
from typing import Any

import pytest

from emulators.devices.rtde import RtdeProfile, RtdeRobot
from emulators.seams import StartPose
from hil_bridge.clock import Clock, run_virtual
from hil_bridge.devices.robots.rtde import port_server as ports
from hil_bridge.devices.wiring import Serving
from hil_bridge.errors import TransportEnded, TransportError, TransportUnavailable
from hil_bridge.transports import connect_bytes
from hil_bridge.transports.memory import listen_memory_clients
from protocol.devices.rtde import packets
from protocol.devices.rtde.packets import Kind

START = StartPose((0.9, -0.1, 0.6), (0.0, 1.0, 0.0, 0.0), 0.2)
ALL = ("timestamp", *(f"output_double_register_{number}" for number in range(48)))


class Client:
    """Data received over a wire, and its end."""

    def __init__(self, wire: Any) -> None:
        self.wire = wire
        self.got = b""
        self.ended: list[TransportError] = []

    def start(self) -> "Client":
        self.wire.start(self._take, self.ended.append)
        return self

    def _take(self, data: bytes) -> None:
        self.got += data


class Site:
    """Controller with its ports in memory."""

    def __init__(self, clock: Clock, robot: RtdeRobot, serving: Serving) -> None:
        self.clock, self.robot, self.serving = clock, robot, serving

    async def client(self, name: str = "ur") -> Client:
        return Client(await connect_bytes(f"memory:{name}", self.clock))

    async def wait(self, seconds: float = 0.01) -> None:
        await self.clock.sleep_until(self.clock.now() + seconds)


def at_site(act: Callable[[Site], Awaitable[None]], profile: RtdeProfile | None = None) -> None:
    async def run() -> None:
        clock = Clock.running()
        robot = RtdeRobot(profile or RtdeProfile(), START, clock.now(), 7)
        failures: list[BaseException] = []
        async with AsyncExitStack() as stack:
            serving = Serving(clock, stack, failures.append, lambda text: None)
            assert await ports.serve("memory:ur", robot, serving) == "memory:ur"
            await act(Site(clock, robot, serving))
        assert not failures

    run_virtual(run)


def test_rtde_serves_many_clients_and_reserves_inputs_once() -> None:
    async def act(site: Site) -> None:
        clients = [(await site.client()).start() for _ in range(3)]
        for client in clients:
            client.wire.send(
                packets.version_request()
                + packets.outputs_request(("timestamp",), 500.0)
                + packets.encode(Kind.START)
            )
        await site.wait(0.101)  # between two packets
        assert len({client.got for client in clients}) == 1
        assert len(clients[0].got) > 50 * 12
        assert len(site.serving.pumps) == 3
        with pytest.raises(TransportUnavailable, match="already in use"):
            listen_memory_clients("ur", site.clock, lambda wire: None)
        for client in clients:
            await client.wire.aclose()
        await site.wait()
        assert site.serving.pumps == []

    at_site(act)


def test_rtde_disconnected_client_releases_inputs() -> None:
    async def act(site: Site) -> None:
        request = packets.inputs_request(("input_int_register_0",))
        first = (await site.client()).start()
        first.wire.send(request)
        await site.wait()
        second = (await site.client()).start()
        second.wire.send(request)
        await site.wait()
        assert b"IN_USE" in second.got
        await first.wire.aclose()
        await site.wait()
        second.wire.send(request)
        await site.wait()
        assert second.got.endswith(b"INT32")

    at_site(act)


def test_rtde_client_that_does_not_read_is_disconnected() -> None:
    async def act(site: Site) -> None:
        deaf, awake = await site.client(), (await site.client()).start()
        for client in (deaf, awake):
            client.wire.send(
                packets.version_request() + packets.outputs_request(ALL, 500.0) + packets.encode(Kind.START)
            )
        await site.wait(2.0)
        assert len(site.serving.pumps) == 1
        assert not awake.ended
        assert len(awake.got) > 990 * 396
        deaf.start()
        await site.wait()
        assert isinstance(deaf.ended[0], TransportEnded)

    at_site(act)


def test_rtde_surplus_client_is_closed() -> None:
    async def act(site: Site) -> None:
        await site.client()
        second = (await site.client()).start()
        await site.wait()
        assert isinstance(second.ended[0], TransportEnded)
        assert site.robot.controller.counts["clients refused"] == 1

    at_site(act, RtdeProfile(max_clients=1))


def test_dashboard_quits_and_accepts_next_client() -> None:
    async def act(site: Site) -> None:
        for _ in range(3):
            client = (await site.client("ur-dashboard")).start()
            client.wire.send(b"robotmode\nquit\nrobotmode\n")
            await site.wait()
            assert client.got == (
                b"Connected: Universal Robots Dashboard Server\nRobotmode: RUNNING\nDisconnected\n"
            )
            assert isinstance(client.ended[0], TransportEnded)

    at_site(act)


def test_rtde_garbage_closes_only_its_connection() -> None:
    async def act(site: Site) -> None:
        good, bad = (await site.client()).start(), (await site.client()).start()
        bad.wire.send(b"\x00\x01U" + bytes(5000))
        await site.wait()
        assert isinstance(bad.ended[0], TransportEnded)
        good.wire.send(packets.version_request())
        await site.wait()
        assert good.got == packets.accepted(Kind.VERSION, True)

    at_site(act)
