"""Times, listeners and disturbances of a CAN bus in memory."""

from collections.abc import Awaitable, Callable
from typing import Any

from hil_bridge.clock import Clock, run_virtual
from hil_bridge.errors import TransportError
from protocol.can.error import CanErrorReport, ErrorState, decode_error
from protocol.can.frame import CanFrame

US = 1e-6
DELIMITER_AND_SLOT = 1 + 1
"""Bits of the CRC delimiter and the ACK slot."""
ERROR_FRAME = 6 + 8
"""Flag and delimiter."""
BETWEEN = 3
SUSPEND = 8
PATIENCE = 0.1


class Log:
    """Arrivals at a node, with the time: frames and error reports separately."""

    def __init__(self, node: Any, clock: Clock) -> None:
        self.items: list[tuple[float, CanFrame]] = []
        self.reports: list[tuple[float, CanErrorReport]] = []
        self.end: TransportError | None = None
        self._clock = clock
        node.start(self._on_data, self._on_end)

    def _on_data(self, frames: Any) -> None:
        for frame in frames:
            assert frame.received_at == self._clock.now()
            if frame.error:
                self.reports.append((frame.received_at, decode_error(frame)))
            else:
                self.items.append((frame.received_at, frame))

    def _on_end(self, error: TransportError) -> None:
        self.end = error

    @property
    def frames(self) -> list[CanFrame]:
        return [frame for _, frame in self.items]

    @property
    def times(self) -> list[float]:
        return [at for at, _ in self.items]

    @property
    def states(self) -> list[ErrorState | None]:
        return [report.state for _, report in self.reports]


def virtual(check: Callable[[Clock], Awaitable[None]]) -> None:
    run_virtual(lambda: check(Clock.running()))  # type: ignore[arg-type, return-value]


class Hits:
    """Disturbs the first frames in the given bits."""

    def __init__(self, *bits: int | None) -> None:
        self._bits = list(bits)

    def __call__(self, frame: CanFrame, bits: int) -> int | None:
        hit = self._bits.pop(0) if self._bits else None
        return bits if hit == -1 else hit
