"""The log of the computer link, put into records that cost a run next to nothing.

A cycle is some twenty pieces of a few bytes and a dozen link events; one record holds many of them, as lines of a text
capture do: seconds since the record's time, `tx` or `rx` as the PC sees it, hexadecimal bytes; or `--` and what the
link made of them, like `ACK sent: block acknowledged`.
"""

from collections.abc import Callable

from hil_bridge.recording.records import LinkRecord

LINK_EVENT = "--"
"""Stands for the direction of what did not travel."""
PIECES = 64
"""Of one record at most."""
SPAN_S = 0.5
"""A record is put when its pieces reach over more than this, so that a killed process loses little."""


class LinkLog:
    """Collects pieces and puts them as records; `flush` before the recorder is closed."""

    def __init__(self, put: Callable[[LinkRecord], object]) -> None:
        self._put = put
        self._begun = 0.0
        self._pieces: list[str] = []

    def take(self, at: float, direction: str, data: bytes) -> None:
        """Keep what was sent (`tx`) or received (`rx`) at a time of the run's clock."""
        self._keep(at, direction + " " + data.hex())  # added: an enum's member costs as much again to format

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

    def flush(self) -> None:
        """Put what has been collected."""
        if self._pieces:
            self._put(LinkRecord(self._begun, tuple(self._pieces)))
            self._pieces = []
