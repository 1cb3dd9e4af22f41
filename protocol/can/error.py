"""Reports of a CAN interface about errors on the bus, in SocketCAN's form.

A report travels as a `CanFrame` with the flag `error`: its identifier is a sum of classes, its eight bytes say
more about each class. Source: linux/can/error.h (Linux 6.1).
"""

from dataclasses import dataclass
from enum import IntEnum, IntFlag, StrEnum

from protocol.can.frame import CanFrame
from protocol.endpoint import LocalProtocolError, RemoteProtocolError

REPORT_BYTES = 8
"""Every report has so many bytes (CAN_ERR_DLC)."""


class ErrorClass(IntFlag):
    """Subject of a report; several may come together."""

    TX_TIMEOUT = 0x001
    """A frame did not leave in time and was given up."""
    LOST_ARBITRATION = 0x002
    CONTROLLER = 0x004
    """The controller's error state or a buffer of it."""
    VIOLATION = 0x008
    TRANSCEIVER = 0x010
    NO_ACKNOWLEDGE = 0x020
    BUS_OFF = 0x040
    BUS_ERROR = 0x080
    RESTARTED = 0x100
    """The controller takes part again."""
    COUNTERS = 0x200
    """The report carries both error counters."""
    INTERFACE_DOWN = 0x1000_0000
    """Ours, far from the classes of Linux: the interface was set down or is gone."""


class Controller(IntFlag):
    """State of the controller and its buffers, byte 1 of a report."""

    RX_OVERFLOW = 0x01
    TX_OVERFLOW = 0x02
    RX_WARNING = 0x04
    TX_WARNING = 0x08
    RX_PASSIVE = 0x10
    TX_PASSIVE = 0x20
    ACTIVE = 0x40


class Violation(IntFlag):
    """Kind of a protocol violation, byte 2 of a report."""

    BIT = 0x01
    FORM = 0x02
    STUFF = 0x04
    DOMINANT_BIT = 0x08
    """A dominant bit could not be sent."""
    RECESSIVE_BIT = 0x10
    """A recessive bit could not be sent."""
    OVERLOAD = 0x20
    ACTIVE = 0x40
    SENDING = 0x80
    """The error happened to a frame of our own."""


class ErrorState(StrEnum):
    """How far a node still takes part. Source: ISO 11898-1, fault confinement; the warning is customary."""

    ACTIVE = "error active"
    WARNING = "error warning"
    PASSIVE = "error passive"
    BUS_OFF = "bus-off"


class _Byte(IntEnum):
    """Place of each matter in the report."""

    ARBITRATION, CONTROLLER, VIOLATION, LOCATION, TRANSCEIVER, SPECIFIC, TRANSMIT_ERRORS, RECEIVE_ERRORS = (
        range(8)
    )


_NO_STATE = Controller(0)
_NO_VIOLATION = Violation(0)


@dataclass(frozen=True, slots=True)
class CanErrorReport:
    """One report of an interface. What belongs to a class that is not named is 0."""

    classes: ErrorClass
    controller: Controller = _NO_STATE
    violation: Violation = _NO_VIOLATION
    location: int = 0
    """Place of the violation in the frame, as numbered in error.h."""
    arbitration_bit: int = 0
    """Bit in which the arbitration was lost; 0 when not known."""
    transceiver: int = 0
    specific: bytes = bytes(3)
    """Details that the controller adds: three bytes, or one when there are counters."""
    counters: tuple[int, int] | None = None
    """Transmit and receive error counter, or None where the interface does not tell."""

    @property
    def state(self) -> ErrorState | None:
        """The error state that the interface has come to, or None when the report is about something else."""
        if ErrorClass.BUS_OFF in self.classes:
            return ErrorState.BUS_OFF
        if ErrorClass.CONTROLLER in self.classes:
            for bits, state in _STATES:
                if self.controller & bits:
                    return state
        return ErrorState.ACTIVE if ErrorClass.RESTARTED in self.classes else None

    def __str__(self) -> str:
        words = [text for part, text in _CLASS_TEXTS.items() if part in self.classes]
        if ErrorClass.CONTROLLER in self.classes:
            words += [text for part, text in _CONTROLLER_TEXTS.items() if part in self.controller]
        if ErrorClass.VIOLATION in self.classes:
            kinds = " and ".join(text for part, text in _VIOLATION_TEXTS.items() if part in self.violation)
            words.append(f"protocol violation: {kinds}" if kinds else "protocol violation")
        if self.counters is not None:
            words.append("transmit errors {}, receive errors {}".format(*self.counters))
        return ", ".join(words) or f"error report {self.classes:#x}"


_STATES = (
    (Controller.RX_PASSIVE | Controller.TX_PASSIVE, ErrorState.PASSIVE),
    (Controller.RX_WARNING | Controller.TX_WARNING, ErrorState.WARNING),
    (Controller.ACTIVE, ErrorState.ACTIVE),
)
_CLASS_TEXTS = {
    ErrorClass.INTERFACE_DOWN: "interface down",
    ErrorClass.BUS_OFF: "bus-off",
    ErrorClass.RESTARTED: "restarted",
    ErrorClass.TX_TIMEOUT: "frames given up",
    ErrorClass.NO_ACKNOWLEDGE: "no acknowledge",
    ErrorClass.LOST_ARBITRATION: "lost arbitration",
    ErrorClass.TRANSCEIVER: "transceiver fault",
    ErrorClass.BUS_ERROR: "bus error",
}
_CONTROLLER_TEXTS = {
    Controller.RX_OVERFLOW: "receive buffer overflow",
    Controller.TX_OVERFLOW: "transmit buffer overflow",
    Controller.RX_WARNING: "error warning by receiving",
    Controller.TX_WARNING: "error warning by sending",
    Controller.RX_PASSIVE: "error passive by receiving",
    Controller.TX_PASSIVE: "error passive by sending",
    Controller.ACTIVE: "error active",
}
_VIOLATION_TEXTS = {
    Violation.BIT: "bit",
    Violation.FORM: "form",
    Violation.STUFF: "stuffing",
    Violation.DOMINANT_BIT: "dominant bit not sent",
    Violation.RECESSIVE_BIT: "recessive bit not sent",
    Violation.OVERLOAD: "overload",
    Violation.ACTIVE: "active error flag",
    Violation.SENDING: "while sending",
}


def encode_error(report: CanErrorReport, at: float | None = None) -> CanFrame:
    """Return the report as a frame, stamped with the time at which the interface made it, s.

    Raises LocalProtocolError for a value that has no place in it.
    """
    has_counters = ErrorClass.COUNTERS in report.classes
    if has_counters != (report.counters is not None):
        raise LocalProtocolError("the class COUNTERS and the counters go together")
    try:
        data = bytes(
            (report.arbitration_bit, report.controller, report.violation, report.location, report.transceiver)
        )
        data += report.specific if report.counters is None else report.specific[:1] + bytes(report.counters)
    except ValueError as error:
        raise LocalProtocolError(f"not a byte of an error report: {error}") from error
    if len(data) != REPORT_BYTES:
        raise LocalProtocolError(f"{len(report.specific)} specific bytes do not fit into an error report")
    identifier = int(report.classes)
    return CanFrame(identifier, data, extended=identifier > 0x7FF, error=True, received_at=at)


def decode_error(frame: CanFrame) -> CanErrorReport:
    """Error report of an interface. Classes and bits that are not known here are kept.

    Raises LocalProtocolError for a frame of a node, RemoteProtocolError for a report of another length.
    """
    if not frame.error:
        raise LocalProtocolError(f"{frame} is a frame of a node, not an error report")
    data = frame.data
    if len(data) != REPORT_BYTES:
        raise RemoteProtocolError(f"an error report has {REPORT_BYTES} bytes, got {len(data)}")
    classes = ErrorClass(frame.identifier)
    has_counters = ErrorClass.COUNTERS in classes
    return CanErrorReport(
        classes,
        Controller(data[_Byte.CONTROLLER]),
        Violation(data[_Byte.VIOLATION]),
        data[_Byte.LOCATION],
        data[_Byte.ARBITRATION],
        data[_Byte.TRANSCEIVER],
        data[_Byte.SPECIFIC : _Byte.TRANSMIT_ERRORS if has_counters else REPORT_BYTES],
        (data[_Byte.TRANSMIT_ERRORS], data[_Byte.RECEIVE_ERRORS]) if has_counters else None,
    )
