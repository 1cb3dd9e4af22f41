"""Devices with several connections: the wires of one client, and datagrams to the client of another connection."""

import asyncio
from typing import Any

from hil_bridge.clock import Clock, run_virtual
from hil_bridge.transports import connect_bytes, listen_datagrams, memory_pair
from hil_bridge.transports.bundle import Bundle
from hil_bridge.transports.tcp import listen_tcp_clients, peer_of
from protocol.datagram import Datagram
from protocol.pieces import Piece


async def send_to_introduced(here: str, there: str, side: Any) -> None:
    clock = Clock.running()
    device = (await listen_datagrams(here, clock)).transport
    client = (await listen_datagrams(there, clock)).transport
    arrived: list[bytes] = []
    client.start(arrived.extend, lambda error: None)
    device.start(lambda data: None, lambda error: None)
    device.send([Datagram(b"to a side that is not known", side=side)])
    device.introduce(side)
    device.send([Datagram(b"first", side=side)])
    await clock.sleep_until(clock.now() + 0.05)
    assert arrived == [b"first"]
    assert device.statistics.dropped == 1
    await device.aclose()
    await client.aclose()


def test_introduced_side_receives_in_memory() -> None:
    run_virtual(lambda: send_to_introduced("udp+memory:device", "udp+memory:client", "client"))


def test_introduced_side_receives_over_udp(unused_udp_port: int) -> None:
    there = f"udp-bind://127.0.0.1:{unused_udp_port}"
    asyncio.run(send_to_introduced("udp-bind://127.0.0.1:0", there, ("127.0.0.1", unused_udp_port)))


def test_wire_of_tcp_client_names_its_host() -> None:
    peers: list[str] = []

    async def main() -> None:
        clock, wires = Clock.running(), []  # type: ignore[var-annotated]
        stop, host, port = await listen_tcp_clients("127.0.0.1", 0, clock, "here", wires.append)
        client = await connect_bytes(f"tcp://{host}:{port}", clock)
        while not wires:
            await clock.sleep_until(clock.now() + 0.005)
        peers.extend(peer_of(wire) for wire in (*wires, client))
        stop()
        for wire in (*wires, client):
            await wire.aclose()

    asyncio.run(asyncio.wait_for(main(), 10.0))
    assert peers == ["127.0.0.1", ""]


def test_bundle_sends_by_port_and_ends_with_its_main_wire() -> None:
    arrived: list[Piece[str, bytes]] = []
    ends: list[Exception] = []

    async def main() -> None:
        clock = Clock.running()
        (a, far_a), (b, far_b) = memory_pair(clock), memory_pair(clock)
        there: dict[str, list[bytes]] = {"a": [], "b": []}
        bundle: Bundle[str] = Bundle("both", {"a": a, "b": b}, "a", lambda: [Piece("b", b"farewell")])
        for far, name in ((far_a, "a"), (far_b, "b")):
            far.start(there[name].append, lambda error: None)
            far.send(name.encode())
        bundle.start(arrived.extend, ends.append)
        bundle.send([Piece("b", b"2"), Piece("a", b"1"), Piece("none", b"3")])
        await clock.sleep_until(clock.now() + 0.01)
        await far_b.aclose()
        await clock.sleep_until(clock.now() + 0.01)
        assert not ends
        await far_a.aclose()
        await clock.sleep_until(clock.now() + 0.01)
        assert len(ends) == 1
        await bundle.aclose()
        assert there == {"a": [b"1"], "b": [b"2"]}  # the farewell could not be sent

    run_virtual(main)
    assert arrived == [Piece("a", b"a"), Piece("b", b"b")]
