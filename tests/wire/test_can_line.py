"""Bits, stuff bits, duration and priority of frames, against published frames and an independent count."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.can.frame import CanFilter, CanFrame
from protocol.can.line import (
    arbitration_rank,
    frame_time_bits,
    line_bits,
    stuff_bits,
    stuffed_bits,
)


def frames() -> st.SearchStrategy[CanFrame]:
    def build(extended: bool, remote: bool, number: int, data: bytes) -> CanFrame:
        limit = 0x1FFFFFFF if extended else 0x7FF
        return CanFrame(number & limit, data, extended=extended, remote=remote)

    return st.builds(build, st.booleans(), st.booleans(), st.integers(0, 2**29 - 1), st.binary(max_size=8))


def spelling_of(frame: CanFrame) -> str:
    """Return the unstuffed bits up to the CRC as text, field by field; the CRC by long division."""
    length = f"{len(frame.data):04b}"
    data = "" if frame.remote else "".join(f"{byte:08b}" for byte in frame.data)
    remote = "1" if frame.remote else "0"
    if frame.extended:
        number = f"{frame.identifier:029b}"
        text = "0" + number[:11] + "11" + number[11:] + remote + "00" + length + data
    else:
        text = "0" + f"{frame.identifier:011b}" + remote + "00" + length + data
    divisor = "1100010110011001"
    rest = list(text + "0" * 15)
    for at in range(len(text)):
        if rest[at] == "1":
            for k, bit in enumerate(divisor):
                rest[at + k] = str(int(rest[at + k] != bit))
    return text + "".join(rest[-15:])


def stuffed(text: str) -> str:
    """Return the text with its stuff bits."""
    out = ""
    for bit in text:
        out += bit
        if out.endswith(("00000", "11111")):
            out += "0" if bit == "1" else "1"
    return out


@pytest.mark.parametrize(
    ("identifier", "data", "checksum"),
    [
        # logic analyser captures of a DiveCAN bus in its public description (QuickRecon/DiveCAN):
        # PPO2 message, calibration request, start of the handset
        (0xD040004, "003A4243", 0x20E8),
        (0xD130201, "6403F6", 0x2146),
        (0xD370401, "A8F300", 0x29DB),
    ],
)
def test_bitwise_crc_matches_captured_frames(identifier: int, data: str, checksum: int) -> None:
    frame = CanFrame(identifier, bytes.fromhex(data), extended=True)
    text = spelling_of(frame)
    assert int(text[-15:], 2) == checksum
    assert len(text) == 39 + 4 * len(data) + 15


def test_nominal_lengths() -> None:
    # ISO 11898-1: 44 bits and 3 of intermission around the data, 20 more for the longer identifier
    for frame, nominal in (
        (CanFrame(0x555), 47),
        (CanFrame(0x555, bytes(8)), 111),
        (CanFrame(0x555, bytes(8), extended=True), 131),
        (CanFrame(0x555, bytes(8), remote=True), 47),
        (CanFrame(0x555, bytes(2), extended=True, remote=True), 67),
    ):
        assert line_bits(frame) - stuff_bits(frame) == nominal
        assert line_bits(frame) == frame_time_bits(frame) + 3
        assert frame_time_bits(frame) == stuffed_bits(frame) + 2 + 8


def test_frame_of_zeros_has_a_stuff_bit_after_every_five() -> None:
    # identifier, length and checksum 0: 34 dominant bits
    assert spelling_of(CanFrame(0)) == "0" * 34
    assert stuff_bits(CanFrame(0)) == 6
    assert line_bits(CanFrame(0)) == 53


def test_thousand_frames_have_the_bits_of_a_bitwise_count() -> None:
    draw = random.Random(11898)
    for _ in range(1000):
        extended = draw.random() < 0.5
        # runs of equal bits, that random bytes rarely have
        data = bytes(
            draw.choice((0x00, 0xFF, 0x1F, 0x83, draw.randrange(256))) for _ in range(draw.randrange(9))
        )
        number = draw.getrandbits(29 if extended else 11) & draw.choice((0, 0x1F00003F, 0x1FFFFFFF))
        frame = CanFrame(number, data, extended=extended, remote=draw.random() < 0.2)
        text = spelling_of(frame)
        line = stuffed(text)
        assert stuff_bits(frame) == len(line) - len(text)
        assert line_bits(frame) == len(line) + 1 + 2 + 7 + 3


@given(frames())
@settings(max_examples=200)
def test_stuff_bits_stay_below_the_known_bound(frame: CanFrame) -> None:
    # Davis et al., Controller Area Network schedulability analysis, 2007: (g + 8 s − 1) / 4
    assert stuff_bits(frame) <= (len(spelling_of(frame)) - 1) // 4


def rivals() -> st.SearchStrategy[CanFrame]:
    """Frames of few identifiers, so that the later bits decide."""

    def build(extended: bool, remote: bool, base: int, extension: int, data: bytes) -> CanFrame:
        number = base << 18 | extension if extended else base
        return CanFrame(number, data, extended=extended, remote=remote)

    parts = st.sampled_from((0, 1, 0x400)), st.sampled_from((0, 1, 0x20000))
    return st.builds(build, st.booleans(), st.booleans(), *parts, st.binary(max_size=2))


@given(rivals(), rivals())
@settings(max_examples=200)
def test_rank_is_the_order_of_arbitration(one: CanFrame, other: CanFrame) -> None:
    def key(frame: CanFrame) -> tuple[int, bool, bool]:
        return frame.identifier, frame.extended, frame.remote

    if key(one) == key(other):
        assert arbitration_rank(one) == arbitration_rank(other)
        return
    ours, theirs = stuffed(spelling_of(one)), stuffed(spelling_of(other))
    winner = next(one if a == "0" else other for a, b in zip(ours, theirs, strict=False) if a != b)
    loser = other if winner is one else one
    assert arbitration_rank(winner) < arbitration_rank(loser)


@pytest.mark.parametrize(
    ("frame", "passes"),
    [
        (CanFrame(0x601), True),
        (CanFrame(0x681), True),
        (CanFrame(0x602), False),
        (CanFrame(0x201), False),
        (CanFrame(0x601, remote=True), True),
        (CanFrame(0x601, extended=True), False),
        (CanFrame(0x040, bytes(8), error=True), True),
    ],
)
def test_filter_compares_the_bits_of_its_mask(frame: CanFrame, passes: bool) -> None:
    assert CanFilter(0x601, 0x77F).accepts(frame) == passes
