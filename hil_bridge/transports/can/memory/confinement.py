"""Fault confinement of a CAN node by its error counters. Source: ISO 11898-1, fault confinement; Bosch CAN 2.0,
part B, chapter 8.
"""

from dataclasses import dataclass, replace

from protocol.can.error import CanErrorReport, Controller, ErrorClass, ErrorState

WARNING_LIMIT = 96
"""Error count at which controllers and SocketCAN report a warning. It is not part of the standard."""
PASSIVE_LIMIT = 128
BUS_OFF_LIMIT = 256
RECOVERY_SEQUENCES = 128
"""Number of sequences of eleven recessive bits that a node must detect before it recovers from bus-off."""

_COUNTER_MAX = 255
"""Maximum value of the receive error counter. Higher values have no meaning, and a report has one byte for the
counter.
"""


@dataclass(frozen=True, slots=True)
class ErrorCounters:
    """Error counters of a node."""

    transmit: int = 0
    receive: int = 0

    @property
    def state(self) -> ErrorState:
        """Error state of the node according to its counters."""
        highest = max(self.transmit, self.receive)
        if self.transmit >= BUS_OFF_LIMIT:
            return ErrorState.BUS_OFF
        if highest >= PASSIVE_LIMIT:
            return ErrorState.PASSIVE
        return ErrorState.WARNING if highest >= WARNING_LIMIT else ErrorState.ACTIVE

    def sent(self) -> "ErrorCounters":
        """Count a frame of this node that was acknowledged."""
        return replace(self, transmit=self.transmit - 1) if self.transmit else self

    def received(self) -> "ErrorCounters":
        """Count a valid frame of another node."""
        return replace(self, receive=min(self.receive, PASSIVE_LIMIT) - 1) if self.receive else self

    def send_failed(self, acknowledge_missing: bool) -> "ErrorCounters":
        """Count an error in a frame of this node. A node that is alone and error passive stops counting; otherwise
        the node that is switched on first would always go bus-off.
        """
        if acknowledge_missing and self.state is ErrorState.PASSIVE:
            return self
        return replace(self, transmit=self.transmit + 8)

    def receive_failed(self) -> "ErrorCounters":
        """Count an error in a frame of another node that all nodes detected at once."""
        return replace(self, receive=min(self.receive + 1, _COUNTER_MAX))


def state_report(counters: ErrorCounters, cause: ErrorClass) -> CanErrorReport:
    """Return the SocketCAN report of a change of the error state. `cause` adds an error class."""
    state = counters.state
    if state is ErrorState.BUS_OFF:
        return CanErrorReport(ErrorClass.BUS_OFF | cause)
    if state is ErrorState.ACTIVE:
        controller = Controller.ACTIVE
    else:
        limit, transmit_flag, receive_flag = _REPORTED[state]
        controller = Controller(0)
        if counters.transmit >= limit:
            controller |= transmit_flag
        if counters.receive >= limit:
            controller |= receive_flag
    return CanErrorReport(
        ErrorClass.CONTROLLER | ErrorClass.COUNTERS | cause,
        controller,
        specific=bytes(1),
        counters=(counters.transmit, counters.receive),
    )


_REPORTED = {
    ErrorState.WARNING: (WARNING_LIMIT, Controller.TX_WARNING, Controller.RX_WARNING),
    ErrorState.PASSIVE: (PASSIVE_LIMIT, Controller.TX_PASSIVE, Controller.RX_PASSIVE),
}
