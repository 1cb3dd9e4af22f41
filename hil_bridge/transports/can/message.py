"""Conversion of python-can's frames, errors and descriptors to the types of this project."""

import errno

import can

from hil_bridge.transports import reasons
from protocol.can.error import REPORT_BYTES
from protocol.can.frame import CanFrame

_FULL = (errno.ENOBUFS, errno.EAGAIN)


def file_descriptor(bus: can.BusABC) -> int:
    """Return the file descriptor on which the event loop waits, or −1 if the interface has none."""
    try:
        return bus.fileno()
    except NotImplementedError:
        return -1


def to_message(frame: CanFrame) -> can.Message:
    """Convert a frame to a message. The length of a remote frame is the requested number of bytes."""
    return can.Message(
        arbitration_id=frame.identifier,
        is_extended_id=frame.extended,
        is_remote_frame=frame.remote,
        dlc=len(frame.data),
        data=b"" if frame.remote else frame.data,
    )


def from_message(message: can.Message, at: float) -> CanFrame | None:
    """Convert a message to a frame, or None if it is not a classical CAN frame."""
    if message.is_fd or (len(message.data) != message.dlc and not message.is_remote_frame):
        return None
    if message.is_error_frame and message.dlc != REPORT_BYTES:
        return None
    try:
        return CanFrame(
            message.arbitration_id,
            bytes(message.dlc) if message.is_remote_frame else bytes(message.data),
            extended=message.is_extended_id,
            remote=message.is_remote_frame,
            error=message.is_error_frame,
            received_at=at,
        ).checked()
    except ValueError:
        return None


def is_full(error: BaseException) -> bool:
    """Return whether sending failed only temporarily. Python-can reports this by error number or by text."""
    return (
        reasons.error_number(error) in _FULL
        or isinstance(error.__cause__, BlockingIOError)
        or str(error).startswith(("Transmit buffer full", "Could not send message to one or more"))
    )
