"""The log of a wire, put into records that cost a run next to nothing.

A cycle of a serial link is some twenty pieces of a few bytes and a dozen link events; one record holds many of
them, as lines of a text capture do: seconds since the record's time, `tx` or `rx` as the PC sees it, and what went
over the wire; or `--` and what the link made of it, like `ACK sent: block acknowledged`.

What went over the wire is hexadecimal bytes, those of several datagrams with a space between them, or CAN frames:
`601#0100FEFF03000700`, eight digits before the sign for an extended identifier, `123#R2` for a remote frame that asks
for two bytes, `004!00` where the interface tells of a bus error. Frames that were handed over together have a piece of
their own for each time at which they came, so that the seconds of a piece may fall, even below 0.
"""

from collections.abc import Callable, Iterator, Sequence
from itertools import groupby
from typing import Any

from protocol.can.frame import CanFrame

LINK_EVENT = "--"
"""Stands for the direction of what did not travel."""
PIECES = 64
"""Most pieces of one record."""
SPAN_S = 0.5
"""A record is put when its pieces reach over more than this, so that a killed process loses little."""


class LinkLog:
    """Collects pieces and gives them to `put` with the time of the first; `flush` before the recorder is closed."""

    def __init__(self, put: Callable[[float, tuple[str, ...]], object]) -> None:
        self._put = put
        self._begun = 0.0
        self._pieces: list[str] = []

    def take(self, at: float, direction: str, data: Any) -> None:
        """Keep bytes, CAN frames or datagrams that were sent (`tx`) or received (`rx`) at a time of the run's clock.

        Frames that know when they came are kept with that time.
        """
        if isinstance(data, bytes):
            self._keep(
                at, direction + " " + data.hex()
            )  # added: an enum's member costs as much again to format
        elif not isinstance(data[0], CanFrame):
            self._keep(at, direction + " " + " ".join([one.hex() for one in data]))
        else:
            for came, frames in _by_time(at, data):
                self._keep(came, direction + " " + " ".join(frames))

    def note(self, at: float, text: str) -> None:
        """Keep a link event."""
        self._keep(at, f"{LINK_EVENT} {text}")

    def _keep(self, at: float, text: str) -> None:
        pieces = self._pieces
        if pieces and (len(pieces) >= PIECES or at - self._begun > SPAN_S):
            self.flush()
            pieces = self._pieces
        if not pieces:
            self._begun = at
        pieces.append(f"{at - self._begun:.6f} {text}")

    def age(self, now: float) -> None:
        """Put what has waited for longer than SPAN_S: the wire may be silent from now on."""
        if self._pieces and now - self._begun > SPAN_S:
            self.flush()

    def flush(self) -> None:
        """Put what has been collected."""
        if self._pieces:
            pieces, self._pieces = self._pieces, []
            self._put(self._begun, tuple(pieces))


def _by_time(at: float, frames: Sequence[CanFrame]) -> Iterator[tuple[float, list[str]]]:
    """Frames in words, neighbours of one time together; `at` is that of a frame that does not know its own."""
    for came, together in groupby(
        frames, lambda frame: at if frame.received_at is None else frame.received_at
    ):
        yield came, [*map(str, together)]
