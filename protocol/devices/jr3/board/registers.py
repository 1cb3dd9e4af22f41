"""Access to a board's memory, the same in every way: emulator, network, a real board on a bus."""

from collections.abc import Sequence
from typing import Protocol


class Registers(Protocol):
    """A board's memory as 16-bit words. `now` is in seconds on the caller's clock and never runs backwards."""

    def read(self, address: int, count: int, now: float) -> tuple[int, ...]:
        """Words 0…65535 of one moment. Raises RemoteProtocolError outside the memory."""

    def burst(self, address: int, count: int, now: float) -> bytes:
        """Read the same words as a wire carries them, `pack_words` of `read`: for a client that reads repeatedly."""

    def write(self, address: int, words: Sequence[int], now: float) -> None:
        """Write words in order of address; a number beyond 16 bits wraps.

        Raises RemoteProtocolError outside the memory.
        """

    def reset(self, now: float) -> None:
        """Restart the board's processor as its reset line does."""

    def load(self, address: int, words: Sequence[int], now: float) -> None:
        """Write instructions from this one on, the low and the high half of each in turn; without words, pull the
        reset line of a processor whose instructions follow.

        Raises RemoteProtocolError for halves without their other, and outside the program's memory.
        """
