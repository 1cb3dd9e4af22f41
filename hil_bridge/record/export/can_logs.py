"""CAN frames as log files of CAN tools; python-can writes BLF and ASC. Times are UNIX time.

| format | time of a frame | notes |
| --- | --- | --- |
| candump | UNIX time, 1 µs | no direction: Wireshark rejects a line with a letter after the frame |
| BLF | UNIX time, about 1 µs | the start time is the first frame's, rounded down to a whole millisecond |
| ASC | since the first frame, 1 µs | that frame's time is in the header: local, 1 ms; an error has no details |
"""

import io
from collections.abc import Iterator, Sequence
from typing import Any

import can

from hil_bridge.record.export.traffic import WireFrame
from hil_bridge.transports.can.message import to_message
from protocol.can.frame import CanFrame

_ERROR_FLAG = 0x20000000
"""Flag of an error frame in the identifier that candump writes. Source: CAN_ERR_FLAG of linux/can.h."""
_BEGIN = "Begin Triggerblock "


class _Text(io.StringIO):
    """Text buffer that stays readable after its writer closes it."""

    def close(self) -> None:
        """Do nothing, to keep the contents."""


class _Bytes(io.BytesIO):
    """Byte buffer that stays readable after its writer closes it."""

    def close(self) -> None:
        """Do nothing, to keep the contents."""


def candump(frames: Sequence[WireFrame], unix_zero_ns: int, channel: str) -> bytes:
    """Return the frames on this channel in the format of `candump -l`.

    The programs `canplayer`, `log2asc` and Wireshark read this format.
    """
    return "".join(_candump_lines(frames, unix_zero_ns, channel)).encode()


def _candump_lines(frames: Sequence[WireFrame], unix_zero_ns: int, channel: str) -> Iterator[str]:
    for one in frames:
        frame = one.frame
        if frame.error:
            frame = CanFrame(frame.identifier | _ERROR_FLAG, frame.data, extended=True)
        seconds, part_us = divmod(round(unix_zero_ns / 1e3 + one.at * 1e6), 1_000_000)
        yield f"({seconds}.{part_us:06d}) {channel} {frame}\n"


def blf(frames: Sequence[WireFrame], unix_zero_ns: int) -> bytes:
    """Return the frames as a BLF file in the format of Vector's tools."""
    file = _Bytes()
    with can.BLFWriter(file) as writer:
        for message in _messages(frames, unix_zero_ns):
            writer.on_message_received(message)
    return file.getvalue()


def asc(frames: Sequence[WireFrame], unix_zero_ns: int) -> bytes:
    """Return the frames as an ASC file in the format of Vector's tools."""
    file = _Text()
    with can.ASCWriter(file) as writer:
        for message in _messages(frames, unix_zero_ns):
            writer.on_message_received(message)
    # the first line is the write time; equal recordings must give equal files
    head, *lines = file.getvalue().splitlines()
    begun = next((line.removeprefix(_BEGIN) for line in lines if line.startswith(_BEGIN)), None)
    return "\n".join([f"date {begun}" if begun else head, *lines, ""]).encode()


def _messages(frames: Sequence[WireFrame], unix_zero_ns: int) -> Iterator[Any]:
    for one in frames:
        message = _message(one.frame)
        message.timestamp = (unix_zero_ns + round(one.at * 1e9)) / 1e9
        message.is_rx = not one.sent
        yield message


def _message(frame: CanFrame) -> can.Message:
    message = to_message(frame)
    message.is_error_frame = frame.error
    return message
