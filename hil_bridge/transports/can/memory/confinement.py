"""Error counters by which a CAN node judges itself.

Source: ISO 11898-1, fault confinement; Bosch CAN 2.0, part B, chapter 8.
"""

from dataclasses import dataclass, replace

from protocol.can.error import CanErrorReport, Controller, ErrorClass, ErrorState

WARNING_LIMIT = 96
"""Not of the standard: where controllers warn, and SocketCAN with them."""
PASSIVE_LIMIT = 128
BUS_OFF_LIMIT = 256
RECOVERY_SEQUENCES = 128
"""How often a node that is bus-off must see eleven recessive bits in a row before it comes back."""

_COUNTER_MAX = 255
"""A receive error counter stops here: no higher value has a meaning, and a report has one byte for it."""


@dataclass(frozen=True, slots=True)
class ErrorCounters:
    """The two error counters of a node."""

    transmit: int = 0
    receive: int = 0

    @property
    def state(self) -> ErrorState:
        """State of the node by its counters."""
        highest = max(self.transmit, self.receive)
        if self.transmit >= BUS_OFF_LIMIT:
            return ErrorState.BUS_OFF
        if highest >= PASSIVE_LIMIT:
            return ErrorState.PASSIVE
        return ErrorState.WARNING if highest >= WARNING_LIMIT else ErrorState.ACTIVE

    def sent(self) -> "ErrorCounters":
        """After a frame of its own was acknowledged."""
        return replace(self, transmit=self.transmit - 1) if self.transmit else self

    def received(self) -> "ErrorCounters":
        """After a good frame of another node."""
        return replace(self, receive=min(self.receive, PASSIVE_LIMIT) - 1) if self.receive else self

    def send_failed(self, acknowledge_missing: bool) -> "ErrorCounters":
        """After an error in a frame of its own.

        A node that is alone and error passive does not count on: else every node that is switched on first
        would go bus-off.
        """
        if acknowledge_missing and self.state is ErrorState.PASSIVE:
            return self
        return replace(self, transmit=self.transmit + 8)

    def receive_failed(self) -> "ErrorCounters":
        """After an error in a frame of another node that all saw at once."""
        return replace(self, receive=min(self.receive + 1, _COUNTER_MAX))


def state_report(counters: ErrorCounters, cause: ErrorClass) -> CanErrorReport:
    """SocketCAN's report when these counters have changed the error state; `cause` adds a class."""
    state = counters.state
    if state is ErrorState.BUS_OFF:
        return CanErrorReport(ErrorClass.BUS_OFF | cause)
    if state is ErrorState.ACTIVE:
        controller = Controller.ACTIVE
    else:
        limit, by_sending, by_receiving = _REPORTED[state]
        controller = Controller(0)
        if counters.transmit >= limit:
            controller |= by_sending
        if counters.receive >= limit:
            controller |= by_receiving
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
