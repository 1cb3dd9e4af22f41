"""A classical CAN frame as it looks on the two wires: its bits, its stuff bits, its time, its rank.

Source: ISO 11898-1 (CAN 2.0 of Bosch, part B, chapters 3 and 5). Dominant is 0, recessive is 1. From the start
of frame to the last bit of the checksum a bit of the other level is stuffed in after five equal ones.

All is by table, a byte of payload at a time: an emulated bus pays for this with every frame.
"""

from functools import lru_cache
from typing import TypeAlias

from protocol.can.frame import CanFrame

CRC_POLYNOMIAL = 0x4599
"""x¹⁵ + x¹⁴ + x¹⁰ + x⁸ + x⁷ + x⁴ + x³ + 1, without its highest term."""

CRC_DELIMITER_BITS = 1
ACK_SLOT_BITS = 1
ACK_DELIMITER_BITS = 1
END_OF_FRAME_BITS = 7
INTERMISSION_BITS = 3
ERROR_FLAG_BITS = 6
ERROR_DELIMITER_BITS = 8
SUSPEND_BITS = 8
"""Wait of an error passive node after a frame of its own before it may send another."""
BUS_FREE_BITS = 11
"""Recessive bits in a row by which a node knows that the bus is free."""

_After: TypeAlias = "list[tuple[int, _After]]"
"""Successors of the present state, by the value of the next byte: the number of stuff bits in the byte, and its
own successors.
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
    """Return the state after one more bit and after the stuff bit that may follow it; how many follow it, 0 or 1.

    A state is last level × 4 + length of its run − 1, with runs of 1 to 4. A run of five has its stuff bit at once,
    which begins a new run.
    """
    level, run = state >> 2, (state & 3) + 1
    run = run + 1 if bit == level else 1
    return (1 - bit << 2, 1) if run == 5 else (bit << 2 | run - 1, 0)


def _stuff_table() -> list[_After]:
    """Successors of every state."""
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
"""State before the start of frame; that is dominant, so that it begins a run whatever the bus did before."""


def stuff_bits(frame: CanFrame) -> int:
    """Count the stuff bits in the frame."""
    register, count, after = _head(frame.identifier, frame.extended, frame.remote, len(frame.data))
    if not frame.remote:
        for byte in frame.data:
            register = (register << 8 & 0x7FFF) ^ _CRC[register >> 7 ^ byte]
            stuffed, after = after[byte]
            count += stuffed
    stuffed, after = after[register >> 7]
    # the last seven bits, and one that makes a byte of them and no stuff bit, for it is unlike the one before it
    end, _ = after[register << 1 & 0xFE | ~register & 1]
    return count + stuffed + end


def stuffed_bits(frame: CanFrame) -> int:
    """Bit times from the start of frame to the end of the checksum: the part in which levels are stuffed."""
    plain = 54 if frame.extended else 34
    return plain + (0 if frame.remote else 8 * len(frame.data)) + stuff_bits(frame)


def frame_time_bits(frame: CanFrame) -> int:
    """Bit times from the start of frame to the end of the end of frame: then the receivers have it."""
    return stuffed_bits(frame) + _TAIL_BITS


def line_bits(frame: CanFrame) -> int:
    """Bit times that the frame keeps the bus from others: with the intermission after it."""
    return frame_time_bits(frame) + INTERMISSION_BITS


def arbitration_rank(frame: CanFrame) -> int:
    """Return the frame's arbitration field as a number: a dominant bit overrules a recessive one, so lower wins.

    Frames of the same rank would destroy each other on a real bus. Stuff bits need not be looked at: up to the
    first difference both frames have the same ones.
    """
    if frame.extended:
        base, extension = frame.identifier >> 18, frame.identifier & 0x3FFFF
        return (base << 2 | 0b11) << 19 | extension << 1 | frame.remote
    return (frame.identifier << 2 | frame.remote << 1) << 19


@lru_cache(maxsize=1024)
def _head(identifier: int, extended: bool, remote: bool, length: int) -> tuple[int, int, _After]:
    """For the bits before the payload: the checksum's register after them, the number of stuff bits, the successors."""
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
