"""A classical CAN frame on the bus: its bits, stuff bits, duration and arbitration priority.

Source: ISO 11898-1 (CAN 2.0 of Bosch, part B, chapters 3 and 5). Dominant is 0, recessive is 1. From the start of
frame to the last bit of the CRC, five equal bits are followed by a stuff bit of the opposite level.

All computation is table-driven, one byte of payload at a time, because an emulated bus performs it for every frame.
"""

from functools import lru_cache
from typing import TypeAlias

from protocol.can.frame import CanFrame

CRC_POLYNOMIAL = 0x4599
"""Generator polynomial of the CRC, x¹⁵ + x¹⁴ + x¹⁰ + x⁸ + x⁷ + x⁴ + x³ + 1, without its highest term."""

CRC_DELIMITER_BITS = 1
ACK_SLOT_BITS = 1
ACK_DELIMITER_BITS = 1
END_OF_FRAME_BITS = 7
INTERMISSION_BITS = 3
ERROR_FLAG_BITS = 6
ERROR_DELIMITER_BITS = 8
SUSPEND_BITS = 8
"""Time, in bit times, that an error-passive node waits after its own frame before it may send again."""
BUS_FREE_BITS = 11
"""Number of consecutive recessive bits after which a node considers the bus idle."""

_After: TypeAlias = "list[tuple[int, _After]]"
"""Transitions from one state, indexed by the next byte: the number of stuff bits in that byte, and the table of the
next state.
"""
_TAIL_BITS = CRC_DELIMITER_BITS + ACK_SLOT_BITS + ACK_DELIMITER_BITS + END_OF_FRAME_BITS


def _crc_table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        register = byte << 7
        for _ in range(8):
            register = (register << 1) ^ (CRC_POLYNOMIAL if register & 0x4000 else 0)
        table.append(register & 0x7FFF)
    return tuple(table)


def _after_bit(state: int, bit: int) -> tuple[int, int]:
    """Return the next state after one bit and its stuff bit, if any, and the number of stuff bits (0 or 1).

    A state is 4 × the last level + the run length − 1, with run lengths from 1 to 4. A run of five immediately gets
    its stuff bit, which starts a new run.
    """
    level, run = state >> 2, (state & 3) + 1
    run = run + 1 if bit == level else 1
    return (1 - bit << 2, 1) if run == 5 else (bit << 2 | run - 1, 0)


def _stuff_table() -> list[_After]:
    """Return the transitions from every state."""
    table: list[_After] = [[] for _ in range(8)]
    for before, entries in enumerate(table):
        for byte in range(256):
            state, stuffed = before, 0
            for shift in range(7, -1, -1):
                state, more = _after_bit(state, byte >> shift & 1)
                stuffed += more
            entries.append((stuffed, table[state]))
    return table


_CRC = _crc_table()
_STUFF = _stuff_table()
_IDLE = 1 << 2
"""State before the start of frame. The start of frame is dominant, so it starts a new run regardless of earlier bus
traffic.
"""


def stuff_bits(frame: CanFrame) -> int:
    """Count the stuff bits in the frame."""
    register, count, after = _head(frame.identifier, frame.extended, frame.remote, len(frame.data))
    if not frame.remote:
        for byte in frame.data:
            register = (register << 8 & 0x7FFF) ^ _CRC[register >> 7 ^ byte]
            stuffed, after = after[byte]
            count += stuffed
    stuffed, after = after[register >> 7]
    # the last seven bits, padded to a byte with a bit that differs from the last bit and so adds no stuff bit
    end, _ = after[register << 1 & 0xFE | ~register & 1]
    return count + stuffed + end


def stuffed_bits(frame: CanFrame) -> int:
    """Return the duration from the start of frame to the end of the CRC, in bit times. Only this section is
    bit-stuffed.
    """
    plain = 54 if frame.extended else 34
    return plain + (0 if frame.remote else 8 * len(frame.data)) + stuff_bits(frame)


def frame_time_bits(frame: CanFrame) -> int:
    """Return the duration from the start of frame to the end of frame, when the receivers accept it, in bit times."""
    return stuffed_bits(frame) + _TAIL_BITS


def line_bits(frame: CanFrame) -> int:
    """Return the duration for which the frame occupies the bus, including the intermission after it, in bit times."""
    return frame_time_bits(frame) + INTERMISSION_BITS


def arbitration_rank(frame: CanFrame) -> int:
    """Return the frame's arbitration field as a number; the lower number wins, because a dominant bit overrides a
    recessive one.

    Frames of equal rank would destroy each other on a real bus. Stuff bits can be ignored: up to the first
    difference, both frames have the same stuff bits.
    """
    if frame.extended:
        base, extension = frame.identifier >> 18, frame.identifier & 0x3FFFF
        return (base << 2 | 0b11) << 19 | extension << 1 | frame.remote
    return (frame.identifier << 2 | frame.remote << 1) << 19


@lru_cache(maxsize=1024)
def _head(identifier: int, extended: bool, remote: bool, length: int) -> tuple[int, int, _After]:
    """Return the state before the payload: the CRC register, the number of stuff bits, and the transition table."""
    if extended:
        # start, 11 bits, substitute remote request 1, identifier extension 1, 18 bits, remote, two reserved 0
        word = (identifier >> 18) << 2 | 0b11
        word = (word << 18 | identifier & 0x3FFFF) << 1 | remote
        word, count = word << 2, 35
    else:
        # start, 11 bits, remote, identifier extension 0, reserved 0
        word, count = (identifier << 1 | remote) << 2, 15
    word, count = word << 4 | length, count + 4
    register, state, stuffed = 0, _IDLE, 0
    for shift in range(count - 1, -1, -1):
        bit = word >> shift & 1
        feedback = bit ^ register >> 14
        register = (register << 1 & 0x7FFF) ^ (CRC_POLYNOMIAL if feedback else 0)
        state, more = _after_bit(state, bit)
        stuffed += more
    return register, stuffed, _STUFF[state]
