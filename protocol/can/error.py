"""Reports of a CAN interface about bus errors, in the format of SocketCAN.

A report is a `CanFrame` with the flag `error`. Its identifier is a combination of error classes; its eight bytes
give the details of each class. Source: linux/can/error.h (Linux 6.1).
"""

from dataclasses import dataclass
from enum import IntEnum, IntFlag, StrEnum

from protocol.can.frame import CanFrame
from protocol.endpoint import LocalProtocolError, RemoteProtocolError

REPORT_BYTES = 8
"""Number of bytes in every report (CAN_ERR_DLC)."""


class ErrorClass(IntFlag):
    """Error class of a report. A report may combine several classes."""

    TX_TIMEOUT = 0x001
    """A frame was not sent in time and was dropped."""
    LOST_ARBITRATION = 0x002
    CONTROLLER = 0x004
    """The controller's error state has changed, or one of its buffers has overflowed."""
    VIOLATION = 0x008
    TRANSCEIVER = 0x010
    NO_ACKNOWLEDGE = 0x020
    BUS_OFF = 0x040
    BUS_ERROR = 0x080
    RESTARTED = 0x100
    """The controller was restarted and takes part in bus traffic again."""
    COUNTERS = 0x200
    """The report carries both error counters."""
    INTERFACE_DOWN = 0x1000_0000
    """The interface was set down or removed. This class is an extension of this project, outside the range used by
    Linux.
    """


class Controller(IntFlag):
    """State of the controller and its buffers, in byte 1 of a report."""

    RX_OVERFLOW = 0x01
    TX_OVERFLOW = 0x02
    RX_WARNING = 0x04
    TX_WARNING = 0x08
    RX_PASSIVE = 0x10
    TX_PASSIVE = 0x20
    ACTIVE = 0x40


class Violation(IntFlag):
    """Kind of a protocol violation, in byte 2 of a report."""

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
    """The error occurred while this node was sending."""


class ErrorState(StrEnum):
    """Fault confinement state of a node. Source: ISO 11898-1, fault confinement; the warning level is common
    practice.
    """

    ACTIVE = "error active"
    WARNING = "error warning"
    PASSIVE = "error passive"
    BUS_OFF = "bus-off"


class _Byte(IntEnum):
    """Index of each item in the report's data."""

    ARBITRATION, CONTROLLER, VIOLATION, LOCATION, TRANSCEIVER, SPECIFIC, TRANSMIT_ERRORS, RECEIVE_ERRORS = (
        range(8)
    )


_NO_STATE = Controller(0)
_NO_VIOLATION = Violation(0)


@dataclass(frozen=True, slots=True)
class CanErrorReport:
    """One error report of an interface. Attributes of classes that are not set are 0."""

    classes: ErrorClass
    controller: Controller = _NO_STATE
    violation: Violation = _NO_VIOLATION
    location: int = 0
    """Position of the violation in the frame, numbered as in error.h."""
    arbitration_bit: int = 0
    """Number of the bit in which arbitration was lost; 0 if unknown."""
    transceiver: int = 0
    specific: bytes = bytes(3)
    """Controller-specific details: three bytes, or one byte if the report carries the counters."""
    counters: tuple[int, int] | None = None
    """Transmit and receive error counters, or None if the interface does not report them."""

    @property
    def state(self) -> ErrorState | None:
        """Error state that the interface has entered, or None if the report is not about the error state."""
        if ErrorClass.BUS_OFF in self.classes:
            return ErrorState.BUS_OFF
        if ErrorClass.CONTROLLER in self.classes:
            for bits, state in _STATES:
                if self.controller & bits:
                    return state
        return ErrorState.ACTIVE if ErrorClass.RESTARTED in self.classes else None

    def __str__(self) -> str:
        texts = [text for part, text in _CLASS_TEXTS.items() if part in self.classes]
        if ErrorClass.CONTROLLER in self.classes:
            texts += [text for part, text in _CONTROLLER_TEXTS.items() if part in self.controller]
        if ErrorClass.VIOLATION in self.classes:
            kinds = " and ".join(text for part, text in _VIOLATION_TEXTS.items() if part in self.violation)
            texts.append(f"protocol violation: {kinds}" if kinds else "protocol violation")
        if self.counters is not None:
            texts.append("transmit errors {}, receive errors {}".format(*self.counters))
        return ", ".join(texts) or f"error report {self.classes:#x}"


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
    """Encode the report as a frame. `at` is the time at which the interface made the report, s.

    Raises LocalProtocolError for a value that does not fit into a report.
    """
    has_counters = ErrorClass.COUNTERS in report.classes
    if has_counters != (report.counters is not None):
        raise LocalProtocolError("the class COUNTERS and the counters must be set together")
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
    """Decode an error report of an interface. Unknown classes and bits are kept.

    Raises LocalProtocolError for a frame sent by a node, and RemoteProtocolError for a report of the wrong length.
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
