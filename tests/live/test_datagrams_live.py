"""Tests of UDP over loopback: the suite of unreliable wires, other senders, and network errors."""

import asyncio
import errno
import os
import selectors
import socket
import sys
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, closing, contextmanager
from functools import partial
from typing import Any

import pytest

from hil_bridge.clock import Clock, run_real
from hil_bridge.errors import TransportBroken, TransportUnavailable
from hil_bridge.runs.compose import emulated_cell
from hil_bridge.runs.setup import Listen, Setup
from hil_bridge.settings.configuration import read_config
from hil_bridge.testing.transports import DatagramCase, Ear, TestDatagramWire
from hil_bridge.transports import DatagramWire, connect_datagrams, listen_datagrams
from hil_bridge.transports.datagram import peer
from protocol.datagram import Datagram

__all__ = ["TestDatagramWire"]

pytestmark = [
    pytest.mark.live,
    pytest.mark.skipif(sys.platform != "linux", reason="the counts of the kernel and its times"),
]

LOOPBACK = ("127.0.0.1", "::1")


class Unplugged:
    """Socket whose interface is gone."""

    def __init__(self, inner: socket.socket) -> None:
        self.fileno, self.close = inner.fileno, inner.close

    def sendto(self, data: bytes, address: Any) -> int:
        raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))

    def recvmsg_into(self, buffers: Any, size: int) -> Any:
        raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))

    def recvmsg(self, *arguments: Any) -> Any:
        raise BlockingIOError


def _unplug(wire: Any) -> None:
    wire._socket = Unplugged(wire._socket)


def _case(host: str) -> DatagramCase:
    @asynccontextmanager
    async def open_ends(clock: Clock) -> AsyncIterator[tuple[DatagramWire, DatagramWire]]:
        listening = await listen_datagrams(f"udp-bind://{host}:0", clock)
        yield await connect_datagrams(listening.address, clock), listening.transport

    return DatagramCase(f"udp {host}", open_ends, cut=_unplug)


def _has(host: str) -> bool:
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((host, 0))
        except OSError:
            return False
    return True


CASES = [_case(f"[{host}]" if ":" in host else host) for host in LOOPBACK if _has(host)]


@pytest.fixture(params=CASES, ids=lambda case: case.name)
def datagram_case(request: pytest.FixtureRequest) -> DatagramCase:
    case: DatagramCase = request.param
    return case


@contextmanager
def _stranger() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        other.settimeout(5)
        yield other


def _port(wire: Any) -> int:
    port: int = wire._socket.getsockname()[1]
    return port


def has_received(ear: Ear) -> bool:
    return len(ear.datagrams) > 0


def has_logged(lines: list[str], count: int) -> bool:
    return sum("has left" in line for line in lines) == count


async def _settled(holds: Callable[[], bool]) -> None:
    for _ in range(1000):
        if holds():
            return
        await asyncio.sleep(0.01)
    raise AssertionError("nothing came within ten seconds")


async def test_initiator_accepts_data_of_its_peer_only() -> None:
    notices: list[str] = []
    with closing(Clock.running()) as clock, _stranger() as other:
        listening = await listen_datagrams("udp-bind://127.0.0.1:0", clock)
        wire = await connect_datagrams(listening.address, clock, lambda kind, text: notices.append(text))
        here, there = Ear(CASES[0], wire), Ear(CASES[0], listening.transport)
        for _ in range(3):
            other.sendto(b"fake", ("127.0.0.1", _port(wire)))
        await _settled(lambda: wire.statistics.refused == 3)
        wire.send([b"ask"])
        await there.until(lambda: there.datagrams == [b"ask"])
        listening.transport.send([b"answer"])
        await here.until(lambda: here.datagrams == [b"answer"])
        assert wire.statistics.strangers == 3
        assert notices == [f"{wire.name}: datagrams of 127.0.0.1:{other.getsockname()[1]} are refused"]
        # bound to the address that leads there alone: from elsewhere it is not to be reached
        assert wire._socket.getsockname()[0] == "127.0.0.1"  # type: ignore[attr-defined]
        await wire.aclose()
        await listening.transport.aclose()


@pytest.mark.parametrize("strangers", ["follow", "refuse"])
async def test_other_sender_is_followed_or_refused(strangers: str) -> None:
    with closing(Clock.running()) as clock, _stranger() as first, _stranger() as second:
        listening = await listen_datagrams(f"udp-bind://127.0.0.1:0?strangers={strangers}", clock)
        wire: Any = listening.transport
        ear = Ear(CASES[0], wire)
        first.sendto(b"one", ("127.0.0.1", _port(wire)))
        await ear.until(lambda: ear.datagrams == [b"one"])
        second.sendto(b"two", ("127.0.0.1", _port(wire)))
        await _settled(lambda: wire.statistics.strangers == 1)
        wire.send([b"answer"])
        answered, other = (second, first) if strangers == "follow" else (first, second)
        assert await asyncio.to_thread(answered.recv, 100) == b"answer"
        other.setblocking(False)
        with pytest.raises(BlockingIOError):
            other.recv(100)
        assert wire.statistics.refused == (strangers == "refuse")
        assert ear.datagrams == ([b"one", b"two"] if strangers == "follow" else [b"one"])
        await wire.aclose()


async def test_other_sender_takes_over_idle_peer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(peer, "IN_USE_S", 0.05)
    with closing(Clock.running()) as clock, _stranger() as first, _stranger() as second:
        listening = await listen_datagrams("udp-bind://127.0.0.1:0?strangers=refuse", clock)
        wire: Any = listening.transport
        ear = Ear(CASES[0], wire)
        first.sendto(b"one", ("127.0.0.1", _port(wire)))
        await ear.until(lambda: ear.datagrams == [b"one"])
        await asyncio.sleep(0.1)
        second.sendto(b"two", ("127.0.0.1", _port(wire)))
        await ear.until(lambda: ear.datagrams == [b"one", b"two"])
        assert wire.statistics.strangers == 0
        await wire.aclose()


async def test_unreachable_port_is_reported_without_ending_wire() -> None:
    notices: list[tuple[str, str]] = []
    with closing(Clock.running()) as clock:
        gone = await listen_datagrams("udp-bind://127.0.0.1:0", clock)
        await gone.transport.aclose()
        wire = await connect_datagrams(gone.address, clock, lambda kind, text: notices.append((kind, text)))
        ear = Ear(CASES[0], wire)
        for _ in range(5):
            wire.send([b"hello", b"twice"])
            await asyncio.sleep(0.02)
        assert wire.statistics.sent == 10
        assert 5 <= wire.statistics.unreachable <= 10
        kind, text = notices[0]
        assert kind == "absent"
        assert f"{gone.address.removeprefix('udp://')} cannot be reached: no program listens there" in text
        assert ear.ends == []
        # a device that is switched on later is heard
        again = await listen_datagrams(gone.address.replace("udp:", "udp-bind:"), clock)
        there = Ear(CASES[0], again.transport)
        wire.send([b"hello"])
        await there.until(lambda: there.datagrams == [b"hello"])
        await wire.aclose()
        await again.transport.aclose()


async def test_robot_without_client_is_reported_once() -> None:
    """The system reports each datagram that no program receives; the emulator prints one line, and continues."""
    messages: list[str] = []
    with closing(Clock.running()) as clock:
        gone = await listen_datagrams("udp-bind://127.0.0.1:0", clock)
        await gone.transport.aclose()
        listen = Listen(f"rsi+{gone.address}", None)
        async with emulated_cell(Setup(read_config({}), listen), clock, lambda cause: None, messages.append):
            await asyncio.sleep(1.3)  # longer than the least time between two notices of a wire
    (line,) = messages
    assert line == f"{gone.address}: waiting for its client; no program is listening there yet"


async def test_end_of_session_is_reported_by_emulated_robot() -> None:
    """The client was connected, and left: the port is not wrong. A client that returns and leaves is reported again."""
    messages: list[str] = []
    with closing(Clock.running()) as clock:
        free = await listen_datagrams("udp-bind://127.0.0.1:0", clock)
        await free.transport.aclose()
        listen = Listen(f"egm+{free.address}", None)
        async with emulated_cell(Setup(read_config({}), listen), clock, lambda cause: None, messages.append):
            for session in (1, 2):
                client = await listen_datagrams(free.address.replace("udp:", "udp-bind:"), clock)
                ear = Ear(CASES[0], client.transport)
                await ear.until(partial(has_received, ear))
                client.transport.send([b"answer"])
                await asyncio.sleep(0.05)
                await client.transport.aclose()
                await _settled(partial(has_logged, messages, session))
                await asyncio.sleep(1.1)  # longer than the least time between two notices of a wire
    place = free.address.removeprefix("udp://")
    left = f"udp://{place}: the program at {place} has left; it had sent datagrams before"
    assert [line for line in messages if "waiting for its client" not in line] == [left, left]
    assert sum("waiting for its client" in line for line in messages) <= 1, "before the first client came"


async def test_error_queue_does_not_keep_loop_busy() -> None:
    with closing(Clock.running()) as clock:
        gone = await listen_datagrams("udp-bind://127.0.0.1:0", clock)
        await gone.transport.aclose()
        wire: Any = await connect_datagrams(gone.address, clock)
        wake_ups = 0
        read = wire._readable

        def counted() -> None:
            nonlocal wake_ups
            wake_ups += 1
            read()

        wire._readable = counted
        Ear(CASES[0], wire)
        wire.send([b"hello"])
        await _settled(lambda: wire.statistics.unreachable == 1)
        await asyncio.sleep(0.1)
        assert wake_ups <= 3
        await wire.aclose()


async def test_pending_datagrams_arrive_in_one_batch() -> None:
    with closing(Clock.running()) as clock:
        listening = await listen_datagrams("udp-bind://127.0.0.1:0", clock)
        wire = await connect_datagrams(listening.address, clock)
        wire.send([b"one"])
        await asyncio.sleep(0.05)
        wire.send([b"two", b"three"])
        await asyncio.sleep(0.05)
        ear, read_at = Ear(CASES[0], listening.transport), clock.now()
        await ear.until(lambda: len(ear.datagrams) == 3)
        assert ear.batches == [[b"one", b"two", b"three"]]
        one, two, _ = ear.batches[0]
        assert isinstance(one, Datagram)
        assert two.received_at - one.received_at >= 0.04
        assert read_at - one.received_at >= 0.08
        await wire.aclose()
        await listening.transport.aclose()


async def test_busy_port_and_invalid_host_are_refused() -> None:
    with closing(Clock.running()) as clock:
        listening = await listen_datagrams("udp-bind://127.0.0.1:0", clock)
        busy = listening.address.replace("udp:", "udp-bind:")
        with pytest.raises(TransportUnavailable, match="already listens on this port"):
            await listen_datagrams(busy, clock)
        with pytest.raises(TransportUnavailable, match="cannot be opened"):
            await connect_datagrams("udp://no-such-host.invalid:4000", clock)
        with pytest.raises(TransportUnavailable, match="not one of this computer's"):
            await listen_datagrams("udp-bind://192.0.2.1:4000", clock)
        with pytest.raises(TransportUnavailable, match="a broadcast address cannot be used"):
            await connect_datagrams("udp://255.255.255.255:4000", clock)
        await listening.transport.aclose()


async def test_sending_over_removed_interface_is_reported() -> None:
    with closing(Clock.running()) as clock:
        wire: Any = await connect_datagrams("udp://127.0.0.1:9", clock)
        ear = Ear(CASES[0], wire)
        _unplug(wire)
        with pytest.raises(TransportBroken, match="No such device"):
            wire.send([b"hello"])
        assert [type(error) for error in ear.ends] == [TransportBroken]


def test_busy_polling_applies_to_datagrams(monkeypatch: pytest.MonkeyPatch) -> None:
    """A polling thread never sleeps before a datagram arrives."""
    waits: list[float | None] = []
    select = selectors.DefaultSelector.select

    def noted(self: Any, timeout: float | None = None) -> Any:
        waits.append(timeout)
        return select(self, timeout)

    async def main() -> None:
        clock = Clock.running()
        listening = await listen_datagrams("udp-bind://127.0.0.1:0", clock, lambda kind, text: None)
        asking = await connect_datagrams(listening.address, clock, lambda kind, text: None)
        arrived: asyncio.Future[Any] = clock.loop.create_future()
        try:
            listening.transport.start(arrived.set_result, lambda cause: None)
            asking.start(lambda data: None, lambda cause: None)
            clock.loop.call_later(0.01, asking.send, [b"1"])
            assert bytes((await arrived)[0]) == b"1"
        finally:
            await asking.aclose()
            await listening.transport.aclose()
            clock.close()

    monkeypatch.setattr(selectors.DefaultSelector, "select", noted)
    run_real(main, busy_poll_s=1.0)
    assert len(waits) > 20
    assert not any(waits), "it slept"
