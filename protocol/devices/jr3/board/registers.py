"""Interface for access to a board's memory, identical for an emulator, a network connection and a real board on a
bus.
"""

from collections.abc import Sequence
from typing import Protocol


class Registers(Protocol):
    """A board's memory as 16-bit words. `now` is in seconds on the caller's clock and never decreases."""

    def read(self, address: int, count: int, now: float) -> tuple[int, ...]:
        """Read consecutive words, 0 … 65535, as one snapshot. Raises RemoteProtocolError outside the memory."""

    def burst(self, address: int, count: int, now: float) -> bytes:
        """Return the result of `read` in wire format, as encoded by `pack_words`, for a client that reads
        repeatedly.
        """

    def write(self, address: int, words: Sequence[int], now: float) -> None:
        """Write words in order of address. A number beyond 16 bits wraps around.

        Raises RemoteProtocolError outside the memory.
        """

    def reset(self, now: float) -> None:
        """Restart the board's processor, as its reset line does."""

    def load(self, address: int, words: Sequence[int], now: float) -> None:
        """Write instructions from the one with number `address` on. `words` alternates between the low and the high
        half of each instruction. Without words, reset the processor before its instructions are written.

        Raises RemoteProtocolError if an instruction is incomplete or outside the program memory.
        """
