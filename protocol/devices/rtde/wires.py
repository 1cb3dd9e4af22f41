"""The connections of one controller, combined into one stream of bytes that name their port."""

from collections.abc import Sequence
from enum import StrEnum
from typing import TypeAlias

from protocol import pieces


class Port(StrEnum):
    """Service on a TCP port of the controller."""

    RTDE = "rtde"
    DASHBOARD = "dashboard"
    SCRIPT = "script"
    """Script port: accepts programs and sends nothing. A client of one interface may use it."""
    PRIMARY = "primary"
    """Primary interface: accepts programs, and sends the state and messages."""
    READ_ONLY = "read-only"
    """Primary interface that accepts no programs."""
    SECONDARY = "secondary"
    """Secondary interface: accepts programs, and sends the state."""
    SECONDARY_READ_ONLY = "secondary-read-only"
    """Secondary interface that accepts no programs."""
    REALTIME = "realtime"
    """Real-time interface: accepts programs, and sends the state in each cycle."""
    REALTIME_READ_ONLY = "realtime-read-only"
    """Real-time interface that accepts no programs."""


CLIENT_PORTS = (Port.RTDE, Port.DASHBOARD, Port.SCRIPT)
"""Ports that the client of this package uses."""


Piece: TypeAlias = pieces.Piece[Port, bytes]
"""Bytes sent or received on one connection."""
Pieces: TypeAlias = Sequence[Piece]
