"""Tests of CAN adapters in real time: slcan, and the interfaces of python-can."""

import asyncio
import os
import sys
import tty
from contextlib import closing

import pytest

from hil_bridge.clock import Clock, run_real
from hil_bridge.errors import ConfigError, TransportBroken, TransportError, TransportUnavailable
from hil_bridge.transports import connect_can
from hil_bridge.transports.can.slcan import SlcanWire
from protocol.can.frame import CanFrame

pytestmark = [
    pytest.mark.live,
    pytest.mark.skipif(os.name != "posix", reason="needs pseudo-terminals"),
]


@pytest.mark.skipif(sys.platform != "linux", reason="SocketCAN")
async def test_missing_can_interface_is_reported() -> None:
    with closing(Clock.running()) as clock:
        with pytest.raises(TransportUnavailable, match=r"no such CAN interface|no SocketCAN"):
            await connect_can("can+socketcan://nocan7", clock)
        with pytest.raises(ConfigError):
            await connect_can("can+socketcan:", clock)


def _received_by_adapter(master: int) -> bytes:
    """Return the bytes sent when a channel opens; a busy computer delivers them in parts."""
    received = b""
    while not received.endswith(b"C\rS8\rO\r"):
        received += os.read(master, 4096)
    return received


async def test_port_in_use_is_not_an_slcan_adapter() -> None:
    master, slave = os.openpty()
    tty.setraw(slave)
    url = f"can+slcan://{os.ttyname(slave)}?bitrate=1000000"
    with closing(Clock.running()) as clock:
        wire = await connect_can(url, clock)
        messages = _received_by_adapter(master)
        with pytest.raises(TransportUnavailable, match="another program holds the port"):
            await connect_can(url, clock)
        os.set_blocking(master, False)
        with pytest.raises(BlockingIOError):  # the first conversation was not disturbed
            os.read(master, 4096)
        assert messages == b"\r\r\rC\rS8\rO\r"
        await wire.aclose()
        await (await connect_can(url, clock)).aclose()
    os.close(master)
    os.close(slave)


async def test_slcan_opens_channel_and_survives_noise() -> None:
    master, slave = os.openpty()
    tty.setraw(slave)
    with closing(Clock.running()) as clock:
        wire = await connect_can(f"can+slcan://{os.ttyname(slave)}?bitrate=1000000", clock)
        assert isinstance(wire, SlcanWire)
        _received_by_adapter(master)
        frames: list[CanFrame] = []
        ends: list[TransportError] = []
        wire.start(frames.extend, ends.append)
        noise = (
            b"\r\r\a",  # acknowledgements and an error without any frame between
            b"t12\r",  # too short
            b"txyz0\r",  # no number
            b"t1008AABB\r",  # fewer bytes than it says
            b"t1009000102030405060708\r",  # more than a frame holds
            b"t-110\r",
            b"\xff\xfe\x80t1000\r",  # no text
            b"hello\r",
            b"x" * 5000,  # a line that does not end
        )
        for k, garbage in enumerate(noise):
            before = wire.statistics.malformed
            os.write(master, garbage)
            await asyncio.sleep(0.02)
            # one ack, then two frames in the same read: all must come out at once
            os.write(master, b"\r\rt%03X2BEEF\r\rt1230\r" % k)
            await asyncio.sleep(0.02)
            assert (wire.statistics.malformed > before) == (garbage != b"\r\r\a")
        assert [frame for frame in frames if frame.identifier != 0x123] == [
            CanFrame(k, b"\xbe\xef") for k in range(len(noise))
        ]
        assert sum(frame == CanFrame(0x123) for frame in frames) == len(noise)
        times = [frame.received_at for frame in frames]
        assert all(at is not None and 0 <= clock.now() - at < 5 for at in times)
        os.write(master, b"T1ABCDEF01FF\rr1230\r")
        wire.send([CanFrame(0x1ABCDEF0, b"\x01", extended=True), CanFrame(0x7FF, remote=True)])
        await asyncio.sleep(0.02)
        assert frames[-2:] == [
            CanFrame(0x1ABCDEF0, b"\xff", extended=True),
            CanFrame(0x123, remote=True),
        ]
        assert os.read(master, 4096) == b"T1ABCDEF0101\rr7FF0\r"
        assert ends == []
        os.close(master)
        await asyncio.sleep(0.05)
        assert [type(error) for error in ends] == [TransportBroken]
        os.close(slave)


async def test_slcan_does_not_block_if_adapter_does_not_read() -> None:
    master, slave = os.openpty()
    tty.setraw(slave)
    with closing(Clock.running()) as clock:
        wire = await connect_can(f"can+slcan://{os.ttyname(slave)}?bitrate=1000000", clock)
        wire.start(lambda frames: None, lambda error: None)
        start = clock.now()
        with pytest.raises(TransportError, match="the send queue is full"):
            wire.send([CanFrame(0x100, bytes(8))] * 10_000)
        assert clock.now() - start < 2.0
        os.close(master)
        await wire.aclose()
        os.close(slave)


async def test_full_virtual_can_queue_refuses() -> None:
    with closing(Clock.running()) as clock:
        deaf = await connect_can("can+virtual://full", clock)
        sender = await connect_can("can+virtual://full", clock)
        with pytest.raises(TransportError, match="the send queue is full"):
            sender.send([CanFrame(0x100)] * 2000)
        await sender.aclose()
        await deaf.aclose()


def test_closing_loop_ends_reader_thread() -> None:
    async def main() -> None:
        with closing(Clock.running()) as clock:
            wire = await connect_can("can+virtual://gone", clock)
            wire.start(lambda frames: None, lambda error: None)
            await wire.aclose()

    run_real(main)
