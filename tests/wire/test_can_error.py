"""Error reports of CAN interfaces: golden frames, round trips, untrusted input, and descriptions."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.can.error import (
    CanErrorReport,
    Controller,
    ErrorClass,
    ErrorState,
    Violation,
    decode_error,
    encode_error,
)
from protocol.can.frame import CanFrame
from protocol.endpoint import LocalProtocolError, RemoteProtocolError

GOLDEN = {
    # (identifier, bytes): report, error state, words. The numbers are those of linux/can/error.h.
    (0x204, "0008000000006000"): (
        # a driver entering the warning state at 96 = 60 hex transmit errors: controller problem 8
        CanErrorReport(
            ErrorClass.CONTROLLER | ErrorClass.COUNTERS,
            Controller.TX_WARNING,
            specific=bytes(1),
            counters=(96, 0),
        ),
        ErrorState.WARNING,
        "error warning by sending, transmit errors 96, receive errors 0",
    ),
    (0x224, "0020000000008000"): (
        CanErrorReport(
            ErrorClass.CONTROLLER | ErrorClass.NO_ACKNOWLEDGE | ErrorClass.COUNTERS,
            Controller.TX_PASSIVE,
            specific=bytes(1),
            counters=(128, 0),
        ),
        ErrorState.PASSIVE,
        "no acknowledge, error passive by sending, transmit errors 128, receive errors 0",
    ),
    (0x040, "0000000000000000"): (CanErrorReport(ErrorClass.BUS_OFF), ErrorState.BUS_OFF, "bus-off"),
    (0x100, "0000000000000000"): (CanErrorReport(ErrorClass.RESTARTED), ErrorState.ACTIVE, "restarted"),
    (0x004, "0040000000000000"): (
        CanErrorReport(ErrorClass.CONTROLLER, Controller.ACTIVE),
        ErrorState.ACTIVE,
        "error active",
    ),
    (0x004, "0001000000000000"): (
        CanErrorReport(ErrorClass.CONTROLLER, Controller.RX_OVERFLOW),
        None,
        "receive buffer overflow",
    ),
    (0x088, "0000842A00000000"): (
        # stuff error of an own frame; location 2A is more than error.h names
        CanErrorReport(
            ErrorClass.VIOLATION | ErrorClass.BUS_ERROR,
            violation=Violation.STUFF | Violation.SENDING,
            location=0x2A,
        ),
        None,
        "bus error, protocol violation: stuffing and while sending",
    ),
    (0x00A, "1D00000000112233"): (
        CanErrorReport(
            ErrorClass.LOST_ARBITRATION | ErrorClass.VIOLATION,
            arbitration_bit=29,
            specific=b"\x11\x22\x33",
        ),
        None,
        "lost arbitration, protocol violation",
    ),
    (0x010, "0000000007000000"): (
        CanErrorReport(ErrorClass.TRANSCEIVER, transceiver=7),
        None,
        "transceiver fault",
    ),
    (0x000, "0000000000000000"): (CanErrorReport(ErrorClass(0)), None, "error report 0x0"),
}


@pytest.mark.parametrize("key", GOLDEN, ids=lambda key: f"{key[0]:03X}#{key[1]}")
def test_golden_frames_feed_encoder_and_decoder(key: tuple[int, str]) -> None:
    report, state, text = GOLDEN[key]
    frame = CanFrame(key[0], bytes.fromhex(key[1]), error=True)
    assert decode_error(frame) == report
    assert encode_error(report) == frame
    assert report.state is state
    assert str(report) == text
    assert str(frame).replace("!", "#") == f"{key[0]:03X}#{key[1]}" != str(frame)


def test_interface_down_is_not_a_linux_report() -> None:
    frame = encode_error(CanErrorReport(ErrorClass.INTERFACE_DOWN), at=2.5)
    assert frame.identifier > 0x7FF
    assert frame.received_at == 2.5
    assert str(decode_error(frame)) == "interface down"


@given(st.integers(0, 2**29 - 1), st.binary(min_size=8, max_size=8))
@settings(max_examples=200)
def test_every_report_survives_the_wire(identifier: int, data: bytes) -> None:
    frame = CanFrame(identifier, data, extended=identifier > 0x7FF, error=True)
    report = decode_error(frame)
    assert encode_error(report) == frame
    assert str(report)
    assert decode_error(encode_error(report)) == report


@given(st.lists(st.sampled_from(sorted(GOLDEN)), max_size=6), st.integers(0, 6))
@settings(max_examples=50)
def test_reports_do_not_depend_on_earlier_ones(keys: list[tuple[int, str]], split: int) -> None:
    batch = [CanFrame(identifier, bytes.fromhex(data), error=True) for identifier, data in keys]
    parts = [decode_error(frame) for part in (batch[:split], batch[split:]) for frame in part]
    assert parts == [GOLDEN[key][0] for key in keys]


@given(st.binary(max_size=7))
@settings(max_examples=50)
def test_short_report_is_refused_and_the_next_one_understood(data: bytes) -> None:
    with pytest.raises(RemoteProtocolError, match=f"8 bytes, got {len(data)}"):
        decode_error(CanFrame(0x040, data, error=True))
    assert decode_error(CanFrame(0x040, bytes(8), error=True)).state is ErrorState.BUS_OFF


@given(st.integers(0, 2**29 - 1), st.binary(max_size=8), st.booleans(), st.booleans())
@settings(max_examples=200)
def test_arbitrary_frames_are_understood_or_refused(
    number: int, data: bytes, error: bool, remote: bool
) -> None:
    frame = CanFrame(number, data, extended=True, remote=remote, error=error)
    try:
        decode_error(frame)
    except (LocalProtocolError, RemoteProtocolError):
        assert not error or len(data) < 8


@pytest.mark.parametrize(
    "report",
    [
        CanErrorReport(ErrorClass.COUNTERS),
        CanErrorReport(ErrorClass.BUS_OFF, counters=(1, 2)),
        CanErrorReport(ErrorClass.BUS_OFF, specific=b""),
        CanErrorReport(ErrorClass.VIOLATION, location=256),
        CanErrorReport(ErrorClass.COUNTERS, counters=(256, 0)),
    ],
)
def test_unencodable_report_is_refused(report: CanErrorReport) -> None:
    with pytest.raises(LocalProtocolError):
        encode_error(report)


def test_frame_of_a_node_is_no_report() -> None:
    with pytest.raises(LocalProtocolError, match="not an error report"):
        decode_error(CanFrame(0x040, bytes(8)))
