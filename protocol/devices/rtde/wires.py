"""The wires of one controller as one: pieces of bytes, each with the port that it goes over."""

from collections.abc import Sequence
from enum import StrEnum
from typing import NamedTuple, TypeAlias


class Port(StrEnum):
    """The service behind a TCP port."""

    RTDE = "rtde"
    DASHBOARD = "dashboard"
    SCRIPT = "script"
    """Takes programs and tells nothing; a client of one interface may use it."""
    PRIMARY = "primary"
    """The primary interface: takes programs, tells the state and messages."""
    READ_ONLY = "read-only"
    """The same without programs."""
    SECONDARY = "secondary"
    """The secondary interface: takes programs, tells the state."""
    SECONDARY_READ_ONLY = "secondary-read-only"
    """The same without programs."""
    REALTIME = "realtime"
    """The real-time interface: takes programs, tells the state in each cycle."""
    REALTIME_READ_ONLY = "realtime-read-only"
    """The same without programs."""


CLIENT_PORTS = (Port.RTDE, Port.DASHBOARD, Port.SCRIPT)
"""Ports that our client uses."""


class Piece(NamedTuple):
    """Bytes of one wire."""

    port: Port
    data: bytes


Pieces: TypeAlias = Sequence[Piece]
