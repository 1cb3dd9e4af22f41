"""Log of a wire, collected into records at almost no cost to the run.

A cycle of a serial link consists of about twenty pieces of a few bytes and a dozen link events. One record holds
many of them as lines in the format of a text capture: seconds since the record's time, `tx` or `rx` as seen by the
PC, and the data; or `--` and the event as the link interprets it, such as `ACK sent: block acknowledged`.

The data are hexadecimal bytes, with a space between datagrams, or CAN frames: `601#0100FEFF03000700`, eight digits
before the sign for an extended identifier, `123#R2` for a remote frame that requests two bytes, `004!00` for a bus
error reported by the interface. Frames and datagrams that were handed over together have one piece for each arrival
time, so the seconds of successive pieces may decrease, even below 0.
"""

from collections.abc import Callable
from itertools import groupby
from typing import Any

from protocol.can.frame import CanFrame
from protocol.datagram import arrived_at

LINK_EVENT = "--"
"""Value of the direction column in a line that is a link event, not data."""
PIECES = 64
"""Maximum number of pieces in one record."""
SPAN_S = 0.5
"""Longest time that a record may span, s. It limits the data that a killed process loses."""


class LinkLog:
    """Collector that passes pieces to `put` with the time of the first piece.

    Call `flush` before closing the recorder.
    """

    def __init__(self, put: Callable[[float, tuple[str, ...]], object]) -> None:
        self._put = put
        self._begun = 0.0
        self._pieces: list[str] = []

    def take(self, at: float, direction: str, data: Any) -> None:
        """Add bytes, CAN frames or datagrams that were sent (`tx`) or received (`rx`) at a time on the run's clock.

        Frames that have an arrival time of their own keep it.
        """
        if isinstance(data, bytes):
            self._keep(
                at, direction + " " + data.hex()
            )  # concatenated: formatting an enum member takes twice as long
        elif isinstance(data[0], CanFrame):
            for came, frames in groupby(
                data, lambda frame: at if frame.received_at is None else frame.received_at
            ):
                self._keep(came, direction + " " + " ".join(map(str, frames)))
        else:
            for came, datagrams in groupby(data, lambda datagram: arrived_at(datagram, at)):
                self._keep(came, direction + " " + " ".join([one.hex() for one in datagrams]))

    def note(self, at: float, text: str) -> None:
        """Add a link event."""
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
        """Pass on pieces older than SPAN_S, in case no more data arrive on the wire."""
        if self._pieces and now - self._begun > SPAN_S:
            self.flush()

    def flush(self) -> None:
        """Pass on all collected pieces."""
        if self._pieces:
            pieces, self._pieces = self._pieces, []
            self._put(self._begun, tuple(pieces))
