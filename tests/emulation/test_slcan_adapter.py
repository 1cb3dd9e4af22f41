"""Tests of the emulated serial CAN adapter: answers like the LAWICEL CAN232, limits, and python-can as its host."""

import can
import pytest
from can.interfaces.slcan import slcanBus
from hypothesis import given
from hypothesis import strategies as st

from emulators.wires.slcan_adapter import Channel, SlcanAdapter, SlcanProfile
from protocol.can.frame import CanFrame
from protocol.can.slcan import SlcanClient

NOW = 1000.25


def exchange(adapter: SlcanAdapter, text: bytes) -> bytes:
    adapter.receive(text, NOW)
    return adapter.data_to_send(NOW)


def accepted_frames(adapter: SlcanAdapter) -> list[CanFrame]:
    frames = []
    while (frame := adapter.next_event()) is not None:
        frames.append(frame)
    return frames


def open_adapter(**profile: int) -> SlcanAdapter:
    adapter = SlcanAdapter(SlcanProfile(**profile))  # type: ignore[arg-type]
    assert exchange(adapter, b"S8\rO\r") == b"\r\r"
    return adapter


def test_transcript_of_manual_matches() -> None:
    adapter = SlcanAdapter(SlcanProfile())
    for command, answer in [
        (b"\r", b"\r"),
        (b"O\r", b"\a"),  # no bit rate yet
        (b"C\r", b"\a"),  # not open
        (b"F\r", b"\a"),
        (b"t10021133\r", b"\a"),
        (b"S9\r", b"\a"),
        (b"S\r", b"\a"),
        (b"S8\r", b"\r"),
        (b"V\r", b"V1013\r"),
        (b"v\r", b"v1013\r"),
        (b"N\r", b"NA123\r"),
        (b"Q\r", b"\a"),
        (b"V1\r", b"\a"),
        (b"O\r", b"\r"),
        (b"O\r", b"\a"),  # open already
        (b"S6\r", b"\a"),  # only while closed
        (b"s0014\r", b"\a"),
        (b"Z1\r", b"\a"),
        (b"t10021133\r", b"z\r"),
        (b"T0000010021133\r", b"Z\r"),
        (b"r1002\r", b"z\r"),
        (b"R000001002\r", b"Z\r"),
        (b"t1003112\r", b"\a"),
        (b"F\r", b"F00\r"),
        (b"C\r", b"\r"),
        (b"L\r", b"\r"),
        (b"t10021133\r", b"\a"),  # only listens
    ]:
        assert exchange(adapter, command) == answer, command
    assert adapter.channel is Channel.LISTENING
    assert accepted_frames(adapter) == [
        CanFrame(0x100, b"\x11\x33"),
        CanFrame(0x100, b"\x11\x33", extended=True),
        CanFrame(0x100, bytes(2), remote=True),
        CanFrame(0x100, bytes(2), extended=True, remote=True),
    ]
    assert adapter.next_deadline() is None


def test_bus_frames_become_text_while_open() -> None:
    frame = CanFrame(0x601, bytes.fromhex("0100FFFF00403412"))
    adapter = SlcanAdapter(SlcanProfile())
    adapter.send_frames([frame], NOW)
    assert adapter.data_to_send(NOW) == b""
    assert exchange(adapter, b"S8\rL\r") == b"\r\r"
    adapter.send_frames([frame, CanFrame(0, error=True)], NOW)
    assert adapter.data_to_send(NOW) == b"t60180100FFFF00403412\r"
    assert exchange(adapter, b"F\rF\r") == b"F80\rF00\r"
    assert exchange(adapter, b"C\rZ1\rO\r") == b"\r\r\r"
    adapter.send_frames([CanFrame(0x80)], 61.0005)
    assert adapter.data_to_send(NOW) == b"t080003E8\r"


@pytest.mark.parametrize(
    ("setup", "passes"), [(b"S8\r", True), (b"s0014\r", True), (b"S6\r", False), (b"s031C\r", False)]
)
def test_no_frame_passes_at_wrong_bit_rate(setup: bytes, passes: bool) -> None:
    adapter = SlcanAdapter(SlcanProfile())
    assert exchange(adapter, setup + b"O\r") == b"\r\r"
    assert exchange(adapter, b"t0800\r") == b"z\r"
    assert accepted_frames(adapter) == [CanFrame(0x80)] * passes
    adapter.send_frames([CanFrame(0x101, b"\0")], NOW)
    assert adapter.data_to_send(NOW) == b"t101100\r" * passes
    assert exchange(adapter, b"F\r") == (b"F00\r" if passes else b"F80\r")


@pytest.mark.parametrize("registers", [b"s\r", b"s00\r", b"s00145\r", b"sxxyy\r", b"s\xff\xff\r"])
def test_invalid_registers_are_refused(registers: bytes) -> None:
    assert exchange(SlcanAdapter(SlcanProfile()), registers) == b"\a"


def test_buffers_are_bounded_and_losses_are_flagged() -> None:
    adapter = open_adapter(frames_limit=3, text_limit=64)
    assert exchange(adapter, b"t0800\r" * 5) == b"z\r" * 3 + b"\a" * 2
    assert len(accepted_frames(adapter)) == 3
    assert exchange(adapter, b"F\r") == b"F02\r"
    adapter.send_frames([CanFrame(0x601, bytes(8))] * 100, NOW)
    assert adapter.data_to_send(NOW) == b"t6018" + b"0" * 16 + b"\r" + b"t6018" + b"0" * 16 + b"\r"
    assert exchange(adapter, b"F\r") == b"F01\r"
    adapter.receive(b"\r" * 1000, NOW)
    assert len(adapter.data_to_send(NOW)) == 64


@given(st.binary(max_size=200), st.integers(1, 9))
def test_frame_is_read_after_arbitrary_bytes(garbage: bytes, size: int) -> None:
    adapter, text = open_adapter(), garbage + b"\rC\rS8\rO\rt0800\r"
    for start in range(0, len(text), size):
        adapter.receive(text[start : start + size], NOW)
    assert adapter.data_to_send(NOW).endswith(b"\r\rz\r")
    assert accepted_frames(adapter)[-1] == CanFrame(0x80)


def test_python_can_opens_sends_and_receives(monkeypatch: pytest.MonkeyPatch) -> None:
    """python-can closes first, opens twice and ignores the answers, BELL included."""
    adapter = SlcanAdapter(SlcanProfile())

    class Port:
        write_timeout: float | None = None

        def __init__(self) -> None:
            self.text = b""

        def write(self, data: bytes) -> None:
            adapter.receive(data, NOW)
            self.text += adapter.data_to_send(NOW)

        @property
        def in_waiting(self) -> int:
            return len(self.text)

        def read(self, size: int) -> bytes:
            data, self.text = self.text[:size], self.text[size:]
            return data

        def flush(self) -> None: ...

        def close(self) -> None: ...

    port = Port()
    monkeypatch.setattr("serial.serial_for_url", lambda *arguments, **settings: port)
    bus = slcanBus("/dev/none", bitrate=1_000_000, sleep_after_open=0)
    assert adapter.channel is Channel.OPEN
    bus.send(can.Message(arbitration_id=0x201, data=bytes.fromhex("C80010270000"), is_extended_id=False))
    assert [str(frame) for frame in accepted_frames(adapter)] == ["201#C80010270000"]
    adapter.send_frames([CanFrame(0x101, b"\0")], NOW)
    port.text += adapter.data_to_send(NOW)
    message = next(m for m in (bus.recv(timeout=0.001) for _ in range(20)) if m is not None)
    assert (message.arbitration_id, bytes(message.data)) == (0x101, b"\0")
    bus.shutdown()
    assert adapter.channel is Channel.CLOSED


def test_our_client_opens_sends_receives_and_closes() -> None:
    adapter, client = SlcanAdapter(SlcanProfile()), SlcanClient(1_000_000)
    client.receive(exchange(adapter, client.data_to_send(NOW)), NOW)
    assert adapter.channel is Channel.OPEN
    client.send([CanFrame(0x201, bytes.fromhex("C80010270000"))])
    client.receive(exchange(adapter, client.data_to_send(NOW)), NOW)
    assert [str(frame) for frame in accepted_frames(adapter)] == ["201#C80010270000"]
    adapter.send_frames([CanFrame(0x101, b"\0")], NOW)
    client.receive(adapter.data_to_send(NOW), NOW)
    assert client.next_event() == CanFrame(0x101, b"\0")
    assert (client.next_event(), client.malformed) == (None, 0)
    client.close()
    exchange(adapter, client.data_to_send(NOW))
    assert adapter.channel is Channel.CLOSED
