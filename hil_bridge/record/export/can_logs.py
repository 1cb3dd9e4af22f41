"""CAN frames as the log files of CAN tools; BLF and ASC are written by python-can. Times are UNIX time.

| format | time of a frame | besides |
| --- | --- | --- |
| candump | UNIX time, 1 µs | no direction: Wireshark reads no line that has a letter behind its frame |
| BLF | UNIX time, about 1 µs | the first frame's time lies at a whole millisecond before it |
| ASC | since the first frame, 1 µs | that frame's time is in the header: local, 1 ms; an error tells no details |
"""

import io
from collections.abc import Iterator, Sequence
from typing import Any

import can

from hil_bridge.record.export.traffic import WireFrame
from hil_bridge.transports.can.message import to_message
from protocol.can.frame import CanFrame

_ERROR_FLAG = 0x20000000
"""In an identifier of candump. Source: CAN_ERR_FLAG of linux/can.h."""
_BEGIN = "Begin Triggerblock "


class _Text(io.StringIO):
    """Stays readable when its writer closes it."""

    def close(self) -> None:
        """Keep it."""


class _Bytes(io.BytesIO):
    """Stays readable when its writer closes it."""

    def close(self) -> None:
        """Keep it."""


def candump(frames: Sequence[WireFrame], unix_zero_ns: int, channel: str) -> bytes:
    """As `candump -l` writes it and `canplayer`, `log2asc` and Wireshark read it, on a channel of this name."""
    return "".join(_candump_lines(frames, unix_zero_ns, channel)).encode()


def _candump_lines(frames: Sequence[WireFrame], unix_zero_ns: int, channel: str) -> Iterator[str]:
    for one in frames:
        frame = one.frame
        if frame.error:
            frame = CanFrame(frame.identifier | _ERROR_FLAG, frame.data, extended=True)
        seconds, part_us = divmod(round(unix_zero_ns / 1e3 + one.at * 1e6), 1_000_000)
        yield f"({seconds}.{part_us:06d}) {channel} {frame}\n"


def blf(frames: Sequence[WireFrame], unix_zero_ns: int) -> bytes:
    """As the tools of Vector write it."""
    file = _Bytes()
    with can.BLFWriter(file) as writer:
        for message in _messages(frames, unix_zero_ns):
            writer.on_message_received(message)
    return file.getvalue()


def asc(frames: Sequence[WireFrame], unix_zero_ns: int) -> bytes:
    """As the tools of Vector write it, in text."""
    file = _Text()
    with can.ASCWriter(file) as writer:
        for message in _messages(frames, unix_zero_ns):
            writer.on_message_received(message)
    # its first line tells when the file was written; the same recording shall give the same file
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
