"""The log of a wire, put into records that cost a run next to nothing.

A cycle of the computer link is some twenty pieces of a few bytes and a dozen link events; one record holds many of
them. They are lines as in a text capture: seconds since the record's time, `tx` or `rx` as the PC sees it, then
hexadecimal bytes or CAN frames. A line with `--` tells an event of the link, like `ACK sent: block acknowledged`.
"""

from collections.abc import Callable

from hil_bridge.transports import Frames

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

    def take(self, at: float, direction: str, data: bytes | Frames) -> None:
        """Keep what was sent (`tx`) or received (`rx`) at a time of the run's clock."""
        text = data.hex() if isinstance(data, bytes) else " ".join(map(str, data))
        self._keep(at, direction + " " + text)  # added: an enum's member costs as much again to format

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
            self._put(self._begun, tuple(self._pieces))
            self._pieces = []
