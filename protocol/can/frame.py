"""One classical CAN frame."""

from dataclasses import dataclass
from typing import NamedTuple


class CanFrame(NamedTuple):
    """A classical CAN data frame with an 11-bit identifier, unless a flag says otherwise.

    A frame with the time of its arrival equals the same frame without.
    """

    identifier: int
    data: bytes = b""
    extended: bool = False
    remote: bool = False
    error: bool = False
    """Not a frame of a node but the interface telling of a bus error."""
    received_at: float | None = None
    """When the interface took it off the bus, seconds on the receiver's clock; None where it cannot say."""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, CanFrame) and self[:5] == other[:5]

    def __ne__(self, other: object) -> bool:
        return not self == other

    def __hash__(self) -> int:
        return hash(self[:5])

    def checked(self) -> "CanFrame":
        """Check this frame, made of values from outside, and return it.

        Raises ValueError for one that no bus could carry.
        """
        limit = 0x1FFFFFFF if self.extended else 0x7FF
        if not 0 <= self.identifier <= limit:
            raise ValueError(f"CAN identifier {self.identifier:#x} is outside 0 … {limit:#x}")
        if len(self.data) > 8:
            raise ValueError(f"a CAN frame holds at most 8 bytes, got {len(self.data)}")
        return self

    def stamped(self, received_at: float) -> "CanFrame":
        """Return the same frame with the time at which an interface received it."""
        return CanFrame(*self[:5], received_at)

    @property
    def identifier_text(self) -> str:
        """The identifier in hexadecimal digits: 8 of an extended one, 3 of another."""
        return f"{self.identifier:0{8 if self.extended else 3}X}"

    def __str__(self) -> str:
        """As candump writes it: `601#0100`, `123#R2` for a remote frame that asks for two bytes; an error with a !."""
        mark = "!" if self.error else "#"
        asked = f"R{len(self.data) or ''}"
        return f"{self.identifier_text}{mark}{asked if self.remote else self.data.hex().upper()}"


@dataclass(frozen=True, slots=True)
class CanFilter:
    """Frames whose identifier has the bits of `identifier` wherever `mask` has a one."""

    identifier: int
    mask: int = 0x7FF
    extended: bool = False

    def accepts(self, frame: CanFrame) -> bool:
        """Whether the frame passes; what an interface reports always does."""
        return frame.error or (
            frame.extended == self.extended and not (frame.identifier ^ self.identifier) & self.mask
        )
