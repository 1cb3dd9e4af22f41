"""Every wire in memory passes the suite of its interface, in virtual time."""

from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import replace
from typing import Any

import pytest

from hil_bridge.clock import Clock
from hil_bridge.errors import TransportBroken, TransportUnavailable
from hil_bridge.testing.transports import DatagramCase, Ends, StreamCase, TestDatagramWire, TestStreamWire
from hil_bridge.testing.wires import Delayed, Faults, Faulty
from hil_bridge.transports import (
    DatagramWire,
    Direction,
    LineSettings,
    MemoryCanBus,
    PacedLine,
    Parity,
    Reconnecting,
    Tap,
    Transport,
    UsbAdapter,
    UsbAdapterProfile,
    connect_bytes,
    connect_can,
    connect_datagrams,
    listen_bytes,
    listen_can,
    listen_datagrams,
    memory_pair,
)
from hil_bridge.transports.serial.rfc2217 import Rfc2217Client, Rfc2217Port

__all__ = ["TestDatagramWire", "TestStreamWire"]


def _around(wrap: Callable[[Transport[bytes], Clock], Transport[bytes]]) -> Callable[[Clock], Any]:
    @asynccontextmanager
    async def open_wrapped(clock: Clock) -> AsyncIterator[Ends]:
        left, right = memory_pair(clock, 0.001)
        yield wrap(left, clock), right

    return open_wrapped


@asynccontextmanager
async def _memory(clock: Clock) -> AsyncIterator[Ends]:
    yield memory_pair(clock)


@asynccontextmanager
async def _memory_url(clock: Clock) -> AsyncIterator[Ends]:
    listening = await listen_bytes("memory:robot", clock)
    yield await connect_bytes("memory:robot?latency_ms=2&baudrate=115200", clock), listening.transport


@asynccontextmanager
async def _adapter_url(clock: Clock) -> AsyncIterator[Ends]:
    listening = await listen_bytes("memory:robot?baudrate=115200", clock)
    yield await connect_bytes("memory:robot?usb_latency_ms=16", clock), listening.transport


@asynccontextmanager
async def _rfc2217(clock: Clock) -> AsyncIterator[Ends]:
    left, right = memory_pair(clock, 0.001)
    server = Rfc2217Port(LINE, clock).serve(right)
    client = Rfc2217Client(left, LINE, clock, lambda kind, text: None)
    await client.ready()
    yield client, server


async def _never() -> Transport[bytes]:
    raise TransportUnavailable("nothing here")


@asynccontextmanager
async def _memory_can(clock: Clock) -> AsyncIterator[Ends]:
    bus = MemoryCanBus(clock, 1_000_000)
    yield bus.connect(), bus.connect()


@asynccontextmanager
async def _memory_can_url(clock: Clock) -> AsyncIterator[Ends]:
    listening = await listen_can("can+memory:sensor?bitrate=500000", clock)
    yield await connect_can("can+memory:sensor", clock), listening.transport


LINE = LineSettings(9600, Parity.EVEN)
CASES = (
    StreamCase("memory", _memory),
    StreamCase("paced", _around(lambda wire, clock: PacedLine(wire, LINE, clock)), volume=60_000),
    StreamCase(
        "usb adapter",
        _around(lambda wire, clock: UsbAdapter(wire, UsbAdapterProfile(), clock)),
        volume=60_000,
    ),
    StreamCase(
        "usb adapter of the peer",
        _around(lambda wire, clock: UsbAdapter(wire, UsbAdapterProfile(), clock, Direction.SENT)),
        volume=60_000,
    ),
    StreamCase("usb adapter on a line", _adapter_url, peer_end_right=None, volume=60_000),
    StreamCase("rfc2217", _rfc2217),
    StreamCase(
        "reconnecting",
        _around(lambda wire, clock: Reconnecting(wire, _never, 0.05, clock, lambda kind, text: None)),
        peer_end=TransportBroken,
    ),
    StreamCase("delayed", _around(lambda wire, clock: Delayed(wire, 0.020, clock))),
    StreamCase("tap", _around(lambda wire, clock: Tap(wire, lambda direction, data: None))),
    StreamCase("faultless", _around(lambda wire, clock: Faulty(wire, Faults()))),
    # a listener stays open when its client leaves
    StreamCase("memory url", _memory_url, peer_end_right=None, volume=60_000),
    StreamCase("memory CAN", _memory_can, frames=True, peer_end=None, peer_end_right=None),
    StreamCase("memory CAN url", _memory_can_url, frames=True, peer_end=None, peer_end_right=None),
)


@pytest.fixture(params=CASES, ids=lambda case: case.name)
def stream_case(request: pytest.FixtureRequest) -> StreamCase:
    return replace(request.param, virtual=True)


def _datagrams(name: str, client: str = "", listener: str = "") -> DatagramCase:
    @asynccontextmanager
    async def open_ends(clock: Clock) -> AsyncIterator[tuple[DatagramWire, DatagramWire]]:
        listening = await listen_datagrams(f"udp+memory:robot{listener}", clock)
        yield await connect_datagrams(f"udp+memory:robot{client}", clock), listening.transport

    return DatagramCase(name, open_ends, cut=lambda wire: wire.cut(), virtual=True)


DATAGRAM_CASES = (
    _datagrams("memory"),
    _datagrams("late", "?latency_ms=5&jitter_ms=3", "?latency_ms=1"),
    _datagrams("lossy", "?loss=0.3&seed=3"),
    _datagrams("doubling", "?duplicate=0.5", "?duplicate=0.2&seed=4"),
    _datagrams("reordering", "?reorder=0.4&latency_ms=2"),
    _datagrams(
        "all faults", "?loss=0.1&duplicate=0.1&reorder=0.1&jitter_ms=4&seed=1", "?loss=0.1&reorder=0.5&seed=2"
    ),
)


@pytest.fixture(params=DATAGRAM_CASES, ids=lambda case: case.name)
def datagram_case(request: pytest.FixtureRequest) -> DatagramCase:
    case: DatagramCase = request.param
    return case
