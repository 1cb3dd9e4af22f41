"""Transmission times of a control cycle on the computer link, computed from the line settings.

Source: computer-link specification, sections 2 and 5: a message is transmitted as ENQ, ACK, block, ACK, EOT.
"""

from protocol.devices.s3.adlp import BLOCK_OVERHEAD, HEADER_SIZE, LinkProfile
from protocol.devices.s3.arap.layouts import STATUS

_AROUND = BLOCK_OVERHEAD + 4
"""Number of characters in a message exchange in addition to its telegram."""


def line_floor(profile: LinkProfile) -> float:
    """Return the minimum transmission time of one cycle, s: a status exchange and a move exchange, without
    turnaround times.
    """
    telegrams = HEADER_SIZE + (HEADER_SIZE + STATUS.size) + profile.move_length + HEADER_SIZE
    return (telegrams + 4 * _AROUND) * profile.character_time


def answer_time(profile: LinkProfile) -> float:
    """Return the time from the start to the end of a status answer on the line, s. It is the age of the position on
    arrival.

    Derived: the controller reads its position, then bids; the EOT ends the answer.
    """
    return (HEADER_SIZE + STATUS.size + _AROUND) * profile.character_time


def move_answer_time(profile: LinkProfile) -> float:
    """Return the time from the start to the end of the answer to a move on the line, s."""
    return (HEADER_SIZE + _AROUND) * profile.character_time
