"""Emulated serial CAN adapter that speaks slcan text to its host, like a LAWICEL CAN232 with auto poll enabled.

Source: LAWICEL CAN232 version 3 manual, February 2010. The adapter answers frames with `z` or `Z` and CR, other
commands with CR, and refused commands with BELL.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, ClassVar

from protocol.can import slcan
from protocol.can.frame import CanFrame
from protocol.can.slcan import TextEnd
from protocol.endpoint import RemoteProtocolError
from protocol.marks import Mark, at_least, check_settings, setting

BIT_RATES = {
    b"0": 10_000,
    b"1": 20_000,
    b"2": 50_000,
    b"3": 100_000,
    b"4": 125_000,
    b"5": 250_000,
    b"6": 500_000,
    b"7": 800_000,
    b"8": 1_000_000,
}
"""Bit rate, bit/s, by the digit of the S command."""
_CLOCK_HZ = 8_000_000
"""Clock frequency of the CAN controller's bit timing registers (s command), Hz."""

_RX_FULL, _TX_FULL, _BUS_ERROR = 0x01, 0x02, 0x80
"""Bits of the status flags."""


class Channel(Enum):
    """State of the CAN side."""

    CLOSED = "closed"
    OPEN = "open"
    LISTENING = "listen only"


@dataclass(frozen=True)
class SlcanProfile:
    """Properties of the bus at the adapter, and the adapter's limits."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    bus_bit_rate: int = setting(
        1_000_000,
        Mark.OBSERVED,
        "bit rate of the bus; at any other rate no frame passes",
        at_least(1),
        unit="bit/s",
    )
    frames_limit: int = setting(1024, Mark.CHOSEN, "maximum number of frames queued for the bus", at_least(1))
    text_limit: int = setting(32768, Mark.CHOSEN, "maximum number of bytes queued for the host", at_least(64))
    version: str = setting("1013", Mark.STANDARD, "hardware and software version, two digits each")
    serial_number: str = setting("A123", Mark.STANDARD, "serial number")

    def __post_init__(self) -> None:
        check_settings(self)


class SlcanAdapter(TextEnd):
    """Endpoint of bytes whose events are the frames that the host sends to the bus."""

    def __init__(self, profile: SlcanProfile) -> None:
        self._profile = profile
        self._lines = slcan.LineDecoder()
        super().__init__()
        self._channel = Channel.CLOSED
        self._bit_rate: float | None = None
        self._timestamps = False
        self._flags = 0

    @property
    def channel(self) -> Channel:
        """State of the CAN side."""
        return self._channel

    @property
    def bus_bit_rate(self) -> int:
        """Bit rate of the bus, bit/s."""
        return self._profile.bus_bit_rate

    # --- text side

    def receive(self, data: bytes, now: float) -> None:
        """Handle commands of the host, and answer each one."""
        for line in self._lines.feed(data):
            self._send(self._answer(line, now))

    # --- CAN side

    def send_frames(self, frames: Sequence[CanFrame], now: float) -> None:
        """Pass frames from the bus to the host.

        Frames are lost while the channel is closed, at a wrong bit rate, or if the host does not read them.
        """
        if self._channel is Channel.CLOSED:
            return
        if not self._on_bus():
            self._flags |= _BUS_ERROR
            return
        stamp = int(now * 1000) if self._timestamps else None
        for frame in frames:
            if frame.error:
                self._flags |= _BUS_ERROR
            elif not self._send(slcan.encode_frame(frame, stamp)):
                self._flags |= _RX_FULL

    # --- commands

    def _send(self, text: bytes) -> bool:
        fits = len(self._text) + len(text) <= self._profile.text_limit
        if fits:
            self._text += text
        return fits

    def _on_bus(self) -> bool:
        """Return whether the bit rate of the adapter matches the bit rate of the bus within the tolerance of the
        bit timing.
        """
        rate = self._bit_rate or 0
        return abs(rate - self._profile.bus_bit_rate) <= 0.005 * self._profile.bus_bit_rate

    def _answer(self, line: bytes, now: float) -> bytes:
        closed = self._channel is Channel.CLOSED
        profile = self._profile
        match line[:1], line[1:]:
            case b"", b"":
                return slcan.CR
            case b"t" | b"T" | b"r" | b"R", _:
                return self._transmit(line, now)
            case b"S", digit if closed and digit in BIT_RATES:
                self._bit_rate = BIT_RATES[digit]
                return slcan.CR
            case b"s", registers if closed:
                return self._set_registers(registers)
            case b"O" | b"L" as letter, b"" if closed and self._bit_rate is not None:
                self._channel = Channel.OPEN if letter == b"O" else Channel.LISTENING
                self._flags = 0
                return slcan.CR
            case b"C", b"" if not closed:
                self._channel = Channel.CLOSED
                return slcan.CR
            case b"Z", b"0" | b"1" as choice if closed:
                self._timestamps = choice == b"1"
                return slcan.CR
            case b"F", b"" if not closed:
                flags, self._flags = self._flags, 0
                return b"F%02X\r" % flags
            case b"V" | b"v" as letter, b"":
                return letter + profile.version.encode("ascii") + slcan.CR
            case b"N", b"":
                return b"N" + profile.serial_number.encode("ascii") + slcan.CR
        return slcan.BELL

    def _set_registers(self, registers: bytes) -> bytes:
        """Set the bit rate from the bit timing registers BTR0 and BTR1 of the CAN controller, given as four digits."""
        try:
            first, second = bytes.fromhex(registers.decode("ascii"))
        except ValueError:
            return slcan.BELL
        # A bit is one quantum, then 1 … 16 quanta before the sampling point and 1 … 8 quanta after it.
        quanta = 3 + (second & 0x0F) + (second >> 4 & 0x07)
        self._bit_rate = _CLOCK_HZ / (((first & 0x3F) + 1) * quanta)
        return slcan.CR

    def _transmit(self, line: bytes, now: float) -> bytes:
        if self._channel is not Channel.OPEN:
            return slcan.BELL
        try:
            frame = slcan.decode_frame(line)
        except RemoteProtocolError:
            return slcan.BELL
        if not self._on_bus():
            self._flags |= _BUS_ERROR  # accepted, and never acknowledged by a node on the bus
        elif len(self._frames) < self._profile.frames_limit:
            self._frames.append(frame)
        else:
            self._flags |= _TX_FULL
            return slcan.BELL
        return (b"Z" if frame.extended else b"z") + slcan.CR
