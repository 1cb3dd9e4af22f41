"""One classical CAN frame."""

from dataclasses import dataclass
from typing import NamedTuple


class CanFrame(NamedTuple):
    """A classical CAN frame: a data frame with an 11-bit identifier unless a flag says otherwise.

    Frames compare equal regardless of their arrival times.
    """

    identifier: int
    data: bytes = b""
    extended: bool = False
    remote: bool = False
    error: bool = False
    """Whether this is an error report of the interface instead of a frame sent by a node."""
    received_at: float | None = None
    """Time at which the interface received the frame, s on the receiver's clock; None if unknown."""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, CanFrame) and self[:5] == other[:5]

    def __ne__(self, other: object) -> bool:
        return not self == other

    def __hash__(self) -> int:
        return hash(self[:5])

    def checked(self) -> "CanFrame":
        """Validate this frame, which was made from external values, and return it.

        Raises ValueError if no bus could carry the frame.
        """
        limit = 0x1FFFFFFF if self.extended else 0x7FF
        if not 0 <= self.identifier <= limit:
            raise ValueError(f"CAN identifier {self.identifier:#x} is outside 0 … {limit:#x}")
        if len(self.data) > 8:
            raise ValueError(f"a CAN frame holds at most 8 bytes, got {len(self.data)}")
        return self

    def stamped(self, received_at: float) -> "CanFrame":
        """Return a copy of the frame with the time at which an interface received it."""
        return CanFrame(*self[:5], received_at)

    @property
    def identifier_text(self) -> str:
        """The identifier in hexadecimal: 8 digits if it is extended, otherwise 3."""
        return f"{self.identifier:0{8 if self.extended else 3}X}"

    def __str__(self) -> str:
        """Return the frame in candump format: `601#0100`, or `123#R2` for a remote frame that requests two bytes.
        An error report has a ! instead of the #.
        """
        mark = "!" if self.error else "#"
        request = f"R{len(self.data) or ''}"
        return f"{self.identifier_text}{mark}{request if self.remote else self.data.hex().upper()}"


@dataclass(frozen=True, slots=True)
class CanFilter:
    """Filter for frames whose identifier equals `identifier` in every bit that is set in `mask`."""

    identifier: int
    mask: int = 0x7FF
    extended: bool = False

    def accepts(self, frame: CanFrame) -> bool:
        """Return whether the frame passes the filter. Error reports of an interface always pass."""
        return frame.error or (
            frame.extended == self.extended and not (frame.identifier ^ self.identifier) & self.mask
        )
