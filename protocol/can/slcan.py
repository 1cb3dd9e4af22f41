"""The text that a serial CAN adapter speaks (slcan): one line per frame or command, ended by CR.

Source: LAWICEL CAN232 version 3 manual, February 2010. `t`/`T` carry data frames with 11-bit and 29-bit
identifiers, `r`/`R` remote frames; with time stamps on, a received frame ends in four digits of milliseconds.
"""

from collections import deque
from collections.abc import Sequence

from protocol.can.frame import CanFrame
from protocol.endpoint import LocalProtocolError, RemoteProtocolError

CR = b"\r"
BELL = b"\a"
"""Answer of an adapter instead of CR when it refuses."""
LONGEST_LINE = 30
"""T, 8 digits, length, 8 bytes, time stamp; without the CR."""
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
"""The command that sets a bit rate in bit/s. Source: the manual; for 83 300 and 750 000 python-can 4.6."""

_DIGITS = frozenset(b"0123456789ABCDEFabcdef")
_KINDS = {b"t": (False, False), b"T": (True, False), b"r": (False, True), b"R": (True, True)}
"""First character of a frame's line: (extended, remote)."""
_ANSWERS = frozenset((b"", b"z", b"Z", b"F", b"V", b"v", b"N"))
"""First characters of an adapter's answers; nothing stands in that of most commands."""
_LETTERS = {flags: letter for letter, flags in _KINDS.items()}


def encode_frame(frame: CanFrame, timestamp_ms: int | None = None) -> bytes:
    """Return the line of a frame, CR included; the number of data bytes of a remote frame is what it asks for.

    Raises LocalProtocolError for a frame that is none (a bus error).
    """
    if frame.error:
        raise LocalProtocolError("a bus error has no line in slcan")
    letter = _LETTERS[frame.extended, frame.remote].decode()
    width = 8 if frame.extended else 3
    data = "" if frame.remote else frame.data.hex().upper()
    stamp = "" if timestamp_ms is None else f"{timestamp_ms % TIMESTAMP_MODULUS_MS:04X}"
    return f"{letter}{frame.identifier:0{width}X}{len(frame.data)}{data}{stamp}\r".encode("ascii")


def decode_frame(line: bytes, *, timestamp: bool = False) -> CanFrame:
    """Return the frame of a line without its CR; a remote frame has as many zero bytes as it asks for.

    Raises RemoteProtocolError for anything else than exactly one frame.
    """
    kind, body = _KINDS.get(line[:1]), line[1:]
    if kind is None or not _DIGITS.issuperset(body):
        raise RemoteProtocolError(f"{line!r} is no slcan frame")
    extended, remote = kind
    width = 8 if extended else 3
    length = body[width] - ord("0") if len(body) > width else 9
    if length > 8:
        raise RemoteProtocolError(f"{line!r} has no data length 0 … 8")
    end = width + 1 + (0 if remote else 2 * length)
    if len(body) != end + (4 if timestamp else 0):
        raise RemoteProtocolError(f"{line!r} does not have the {length} bytes that it announces")
    data = bytes(length) if remote else bytes.fromhex(body[width + 1 : end].decode())
    try:
        return CanFrame(int(body[:width], 16), data, extended=extended, remote=remote).checked()
    except ValueError as error:
        raise RemoteProtocolError(f"{line!r}: {error}") from error


class LineDecoder:
    """Cuts a byte stream into lines at CR and holds no more than the longest line.

    A line that is too long comes out cut to `LONGEST_LINE` + 1 bytes, which no frame or command has.
    """

    def __init__(self) -> None:
        self._tail = b""

    def feed(self, data: bytes) -> list[bytes]:
        """Return the lines that these bytes complete, without their CR."""
        *lines, tail = (self._tail + data).split(CR)
        self._tail = tail[: LONGEST_LINE + 1]
        return [line[: LONGEST_LINE + 1] for line in lines]


class TextEnd:
    """One end of the text of an adapter: text that waits to be sent, frames that wait to be taken, and no deadline."""

    def __init__(self, text: bytes = b"") -> None:
        self._text = bytearray(text)
        self._frames: deque[CanFrame] = deque()

    def next_event(self) -> CanFrame | None:
        """Return the oldest received frame not yet taken, or None."""
        return self._frames.popleft() if self._frames else None

    def data_to_send(self, now: float) -> bytes:
        """Text for the other end."""
        text = bytes(self._text)
        self._text.clear()
        return text

    def next_deadline(self) -> float | None:
        """Nothing here happens by time."""
        return None

    def handle_deadline(self, now: float) -> None:
        """Nothing here happens by time."""


class SlcanClient(TextEnd):
    """The host's side of an adapter: an endpoint of bytes whose events are the frames from the bus.

    It opens the channel with its first bytes. Answers to commands are passed over, refusals too, for not every
    adapter gives them. A frame may carry a time stamp, which is not used: its clock is the adapter's.
    """

    def __init__(self, bitrate: int | None = None) -> None:
        # Empty lines end a command that an earlier host left incomplete. Source: CAN232 manual.
        rate = b"" if bitrate is None else BIT_RATE_COMMANDS[bitrate]
        super().__init__(b"\r\r\rC\r" + rate + b"O\r")
        self._lines = LineDecoder()
        self.malformed = 0
        """Lines that were neither a frame nor an answer."""

    def send(self, frames: Sequence[CanFrame]) -> None:
        """Put frames on the bus. Raises LocalProtocolError for a bus error among them."""
        self._text += b"".join(map(encode_frame, frames))

    def close(self) -> None:
        """Close the channel."""
        self._text += b"C\r"

    def receive(self, data: bytes, now: float) -> None:
        """Text of the adapter."""
        for line in self._lines.feed(data.replace(BELL, CR)):
            if line[:1] in _KINDS:
                self._take(line, now)
            elif line[:1] not in _ANSWERS:
                self.malformed += 1

    def _take(self, line: bytes, now: float) -> None:
        for timestamp in (False, True):
            try:
                self._frames.append(decode_frame(line, timestamp=timestamp).stamped(now))
                return
            except RemoteProtocolError:
                continue
        self.malformed += 1
