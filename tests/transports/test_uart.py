"""The UART model: what a receiver reads with settings other than the sender's, computed by hand where possible."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hil_bridge.transports.serial.uart import (
    COUNTED_AS,
    Character,
    Damaged,
    Flaw,
    LineErrors,
    LineSettings,
    Parity,
    Receiver,
    levels,
    taken,
)

N, E, O = (LineSettings(9600, parity) for parity in (Parity.NONE, Parity.EVEN, Parity.ODD))  # noqa: E741
LINES = st.builds(
    LineSettings,
    st.sampled_from((300, 4800, 9600, 14_400, 19_200, 115_200)),
    st.sampled_from(Parity),
    st.sampled_from((1, 2)),
)
ENQ, ACK = 0x05, 0x06


def begins(number: int, sender: LineSettings) -> float:
    """Return the start of this character of an uninterrupted burst, s, with the same rounding everywhere."""
    return number * sender.bits / sender.baudrate


def read(data: bytes, sender: LineSettings, receiver: LineSettings) -> list[Character]:
    """Return the characters read from an uninterrupted burst, after which the line is idle."""
    ear = Receiver(receiver)
    for k, byte in enumerate(data):
        ear.character(byte, begins(k, sender), sender)
    return ear.listen(1000.0)


def test_uart_levels_follow_bit_order() -> None:
    assert levels(ENQ, N) == (0, 1, 0, 1, 0, 0, 0, 0, 0, 1)
    assert levels(ENQ, E) == (0, 1, 0, 1, 0, 0, 0, 0, 0, 0, 1)  # two ones: the even parity bit is 0
    assert levels(0x10, E) == (0, 0, 0, 0, 0, 1, 0, 0, 0, 1, 1)
    assert levels(ENQ, O) == (0, 1, 0, 1, 0, 0, 0, 0, 0, 1, 1)
    assert levels(0xFF, LineSettings(300, Parity.ODD, 2)) == (0, *[1] * 8, 1, 1, 1)


@given(st.binary(max_size=20), LINES)
@settings(max_examples=100, deadline=None)
def test_uart_equal_settings_receive_every_byte(data: bytes, line: LineSettings) -> None:
    assert read(data, line, line) == [Character(byte) for byte in data]


@given(st.binary(max_size=20), st.sampled_from(Parity), st.integers(-38, 38))
@settings(max_examples=100, deadline=None)
def test_uart_tolerates_four_percent_rate_error(data: bytes, parity: Parity, per_mille: int) -> None:
    sender = LineSettings(9600 * (1000 + per_mille) // 1000, parity)
    assert read(data, sender, LineSettings(9600, parity)) == [Character(byte) for byte in data]


@pytest.mark.parametrize(
    ("data", "sender", "receiver", "expected"),
    [
        # the parity bit 0 is where 8N1 has its stop bit; read as a start bit, it is followed by an idle line
        ([ACK], E, N, [Character(ACK, Flaw.FRAMING), Character(0xFF)]),
        # a parity bit 1 passes for a stop bit
        ([0x10], E, N, [Character(0x10)]),
        ([0x10, 0x02], E, N, [Character(0x10), Character(0x02)]),
        # 05 with the parity bit 0; the next start bit then is that parity bit, its data: stop 1, start 0, bits 0-5
        ([ENQ, 0x15], E, N, [Character(ENQ, Flaw.FRAMING), Character(0x55, Flaw.FRAMING), Character(0xFE)]),
        # the stop bit 1 of 8N1 is where 8E1 has its parity bit, which should be 0
        ([ENQ], N, E, [Character(ENQ, Flaw.PARITY)]),
        ([0x10], N, E, [Character(0x10)]),
        ([ENQ], E, O, [Character(ENQ, Flaw.PARITY)]),
        ([0x00], N, N, [Character(0)]),
        # twice as fast: a low start bit is too short to be one, unless a 0 follows
        ([0xFF], LineSettings(19_200), N, []),
        # of every two bits the second is read: (start 0)(0 0)(0 0)(0 0)(0 stop), then idle
        ([0x00], LineSettings(19_200), N, [Character(0b1111_1000)]),
        # half as fast: each bit is read twice, 0 0 1 1 0 0 1 1 0|0 begins another, 1 1 0 0 1 1 0 0 1
        ([0x55], LineSettings(4800), N, [Character(0b0110_0110, Flaw.FRAMING), Character(0b0011_0011)]),
        # only zeros for longer than a character
        ([0x00], LineSettings(4800), N, [Character(0, Flaw.BREAK)]),
    ],
)
def test_uart_reads_examples_computed_by_hand(
    data: list[int], sender: LineSettings, receiver: LineSettings, expected: list[Character]
) -> None:
    assert read(bytes(data), sender, receiver) == expected


@pytest.mark.parametrize(
    ("sender", "receiver"),
    # between odd and none they do: both characters have an even number of ones, and an odd parity bit 1
    [(a, b) for a in (N, E, O) for b in (N, E, O) if a != b and E in (a, b)]
    + [(E, LineSettings(rate, Parity.EVEN)) for rate in (4800, 19_200)],
    ids=str,
)
def test_uart_bid_fails_between_different_settings(sender: LineSettings, receiver: LineSettings) -> None:
    for byte in (ENQ, ACK):
        good = [character.byte for character in read(bytes([byte]), sender, receiver) if not character.flaw]
        assert byte not in good


@given(st.binary(min_size=1, max_size=12), LINES, LINES, st.data())
@settings(max_examples=200, deadline=None)
def test_uart_reads_same_in_pieces(
    data: bytes, sender: LineSettings, receiver: LineSettings, draw: st.DataObject
) -> None:
    ear, characters = Receiver(receiver), []
    for k, byte in enumerate(data):
        ear.character(byte, begins(k, sender), sender)
        if draw.draw(st.booleans()):
            # up to the next character, whose first edge has not been reported yet
            characters += ear.listen(math.nextafter(begins(k + 1, sender), 0.0))
    characters += ear.listen(1000.0)
    assert characters == read(data, sender, receiver)
    assert ear.quiet


@given(st.binary(max_size=12), LINES, LINES)
@settings(max_examples=100, deadline=None)
def test_uart_resynchronizes_after_idle_time(
    garbage: bytes, sender: LineSettings, receiver: LineSettings
) -> None:
    ear = Receiver(receiver)
    for k, byte in enumerate(garbage):
        ear.character(byte, k * sender.bits / sender.baudrate, sender)
    ear.character(ENQ, 10.0, receiver)
    assert ear.listen(11.0)[-1] == Character(ENQ)


def test_uart_break_is_one_zero_until_line_is_high() -> None:
    ear = Receiver(E)
    ear.hold(True, 1.0)
    assert ear.listen(1.0 + 10.5 / 9600) == []
    assert ear.deadline == pytest.approx(1.0 + 10.53 / 9600, abs=1e-6)
    assert ear.listen(1.5) == [Character(0, Flaw.BREAK)]
    assert not ear.quiet
    ear.character(ENQ, 1.6, E)  # sent, but the line is held
    ear.hold(False, 2.0)
    ear.character(ACK, 2.5, E)
    assert ear.listen(3.0) == [Character(ACK)]
    assert ear.quiet


def test_uart_changed_settings_discard_present_character() -> None:
    ear = Receiver(N)
    ear.character(ENQ, 0.0, N)
    assert ear.listen(3 / 9600) == []
    ear.retune(E)
    ear.character(ACK, 1.0, E)
    assert ear.listen(2.0)[-1] == Character(ACK)


def test_uart_damaged_characters_are_read_as_configured() -> None:
    characters = [
        Character(1),
        Character(2, Flaw.PARITY),
        Character(0, Flaw.BREAK),
        Character(3, Flaw.FRAMING),
    ]
    assert taken(characters, Damaged.KEEP) == b"\x01\x02\x00\x03"
    assert taken(characters, Damaged.ZERO) == b"\x01\x00\x00\x00"
    assert taken(characters, Damaged.DROP) == b"\x01"


def test_uart_counts_errors_by_kind() -> None:
    total = LineErrors()
    for flaw in (Flaw.PARITY, Flaw.FRAMING, Flaw.FRAMING, Flaw.BREAK):
        total += COUNTED_AS[flaw]
    assert total == LineErrors(1, 2, 1)
    assert str(total) == "1 parity errors, 2 framing errors, 1 breaks"
    assert str(LineErrors()) == "no line errors"
