"""Text protocol of serial CAN adapters (slcan): one line per frame or command, terminated by CR.

Source: LAWICEL CAN232 version 3 manual, February 2010. `t` and `T` mark data frames with 11-bit and 29-bit
identifiers, `r` and `R` remote frames. With time stamps enabled, the line of a received frame ends with a time
stamp of four digits, in milliseconds.
"""

from collections import deque
from collections.abc import Sequence

from protocol.can.frame import CanFrame
from protocol.endpoint import LocalProtocolError, RemoteProtocolError

CR = b"\r"
BELL = b"\a"
"""Response of an adapter that refuses a command; it replaces the CR."""
LONGEST_LINE = 30
"""Length of the longest line without the CR, in characters: T, 8 digits, length, 8 bytes, time stamp."""
TIMESTAMP_MODULUS_MS = 60000
BIT_RATE_COMMANDS = {
    10_000: b"S0\r",
    20_000: b"S1\r",
    50_000: b"S2\r",
    83_300: b"S9\r",
    100_000: b"S3\r",
    125_000: b"S4\r",
    250_000: b"S5\r",
    500_000: b"S6\r",
    750_000: b"S7\r",
    1_000_000: b"S8\r",
}
"""Command for each bit rate, in bit/s. Source: the manual; for 83 300 and 750 000, python-can 4.6."""

_DIGITS = frozenset(b"0123456789ABCDEFabcdef")
_KINDS = {b"t": (False, False), b"T": (True, False), b"r": (False, True), b"R": (True, True)}
"""Frame kind, as (extended, remote), by the first character of the line."""
_ANSWERS = frozenset((b"", b"z", b"Z", b"F", b"V", b"v", b"N"))
"""Possible first characters of an adapter's responses. The response to most commands is empty."""
_LETTERS = {flags: letter for letter, flags in _KINDS.items()}


def encode_frame(frame: CanFrame, timestamp_ms: int | None = None) -> bytes:
    """Encode a frame as a line, including the CR. The length of a remote frame is the number of bytes that it
    requests.

    Raises LocalProtocolError for a bus error, which is not a frame.
    """
    if frame.error:
        raise LocalProtocolError("a bus error cannot be sent over slcan")
    letter = _LETTERS[frame.extended, frame.remote].decode()
    width = 8 if frame.extended else 3
    data = "" if frame.remote else frame.data.hex().upper()
    stamp = "" if timestamp_ms is None else f"{timestamp_ms % TIMESTAMP_MODULUS_MS:04X}"
    return f"{letter}{frame.identifier:0{width}X}{len(frame.data)}{data}{stamp}\r".encode("ascii")


def decode_frame(line: bytes, *, timestamp: bool = False) -> CanFrame:
    """Decode a frame from a line without its CR. A remote frame gets as many zero bytes as it requests.

    Raises RemoteProtocolError if the line is not exactly one frame.
    """
    kind, body = _KINDS.get(line[:1]), line[1:]
    if kind is None or not _DIGITS.issuperset(body):
        raise RemoteProtocolError(f"{line!r} is not an slcan frame")
    extended, remote = kind
    width = 8 if extended else 3
    length = body[width] - ord("0") if len(body) > width else 9
    if length > 8:
        raise RemoteProtocolError(f"{line!r} has an invalid data length; allowed: 0 … 8")
    end = width + 1 + (0 if remote else 2 * length)
    if len(body) != end + (4 if timestamp else 0):
        raise RemoteProtocolError(
            f"{line!r} does not have the {length} data bytes that its length field states"
        )
    data = bytes(length) if remote else bytes.fromhex(body[width + 1 : end].decode())
    try:
        return CanFrame(int(body[:width], 16), data, extended=extended, remote=remote).checked()
    except ValueError as error:
        raise RemoteProtocolError(f"{line!r}: {error}") from error


class LineDecoder:
    """Splitter of a byte stream into lines at CR. It buffers no more than the longest line.

    A line that is too long is returned truncated to `LONGEST_LINE` + 1 bytes, which matches no frame or command.
    """

    def __init__(self) -> None:
        self._tail = b""

    def feed(self, data: bytes) -> list[bytes]:
        """Process received bytes and return the lines that they complete, without their CR."""
        *lines, tail = (self._tail + data).split(CR)
        self._tail = tail[: LONGEST_LINE + 1]
        return [line[: LONGEST_LINE + 1] for line in lines]


class TextEnd:
    """Base class of both ends of an adapter connection: outgoing text and received frames. It has no deadline."""

    def __init__(self, text: bytes = b"") -> None:
        self._text = bytearray(text)
        self._frames: deque[CanFrame] = deque()

    def next_event(self) -> CanFrame | None:
        """Return the oldest received frame not yet taken, or None."""
        return self._frames.popleft() if self._frames else None

    def data_to_send(self, now: float) -> bytes:
        """Return the text to send to the other end."""
        text = bytes(self._text)
        self._text.clear()
        return text

    def next_deadline(self) -> float | None:
        """Return None, because nothing here depends on time."""
        return None

    def handle_deadline(self, now: float) -> None:
        """Do nothing, because nothing here depends on time."""


class SlcanClient(TextEnd):
    """Host side of an adapter: a byte endpoint whose events are the frames from the bus.

    The first bytes that it sends open the channel. It ignores all responses to commands, including refusals,
    because not every adapter sends them. It ignores the time stamps of frames, because they refer to the adapter's
    clock.
    """

    def __init__(self, bitrate: int | None = None) -> None:
        # Empty lines end a command that an earlier host left incomplete. Source: CAN232 manual.
        rate = b"" if bitrate is None else BIT_RATE_COMMANDS[bitrate]
        super().__init__(b"\r\r\rC\r" + rate + b"O\r")
        self._lines = LineDecoder()
        self.malformed = 0
        """Number of lines that were neither a frame nor a response."""

    def send(self, frames: Sequence[CanFrame]) -> None:
        """Send frames to the bus. Raises LocalProtocolError if one of them is a bus error report."""
        self._text += b"".join(map(encode_frame, frames))

    def close(self) -> None:
        """Close the channel."""
        self._text += b"C\r"

    def receive(self, data: bytes, now: float) -> None:
        """Process text from the adapter."""
        for line in self._lines.feed(data.replace(BELL, CR)):
            if line[:1] in _KINDS:
                self._process_line(line, now)
            elif line[:1] not in _ANSWERS:
                self.malformed += 1

    def _process_line(self, line: bytes, now: float) -> None:
        for timestamp in (False, True):
            try:
                self._frames.append(decode_frame(line, timestamp=timestamp).stamped(now))
                return
            except RemoteProtocolError:
                continue
        self.malformed += 1
