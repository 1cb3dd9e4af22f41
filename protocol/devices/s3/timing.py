"""Time of a control cycle's characters on the computer link, by arithmetic from its line.

Source: computer-link specification, sections 2 and 5: a message travels as ENQ, ACK, block, ACK, EOT.
"""

from protocol.devices.s3.adlp import BLOCK_OVERHEAD, HEADER_SIZE, LinkProfile
from protocol.devices.s3.arap.layouts import STATUS

_AROUND = BLOCK_OVERHEAD + 4
"""Characters of an exchange beside its telegram."""


def line_floor(profile: LinkProfile) -> float:
    """Shortest time of one cycle's characters on the line, s: a status and a move, without turnaround."""
    telegrams = HEADER_SIZE + (HEADER_SIZE + STATUS.size) + profile.move_length + HEADER_SIZE
    return (telegrams + 4 * _AROUND) * profile.character_time


def answer_time(profile: LinkProfile) -> float:
    """From a status answer's beginning to its end on the line, s: how old the position in it is on arrival.

    Derived: the controller reads its position, bids, and is done with the EOT.
    """
    return (HEADER_SIZE + STATUS.size + _AROUND) * profile.character_time


def move_answer_time(profile: LinkProfile) -> float:
    """Time from the beginning of a move's answer to its end on the line, s."""
    return (HEADER_SIZE + _AROUND) * profile.character_time
