"""The connections of one controller, combined into one stream of pieces that name their channel."""

from collections.abc import Sequence
from enum import StrEnum
from typing import NamedTuple, TypeAlias


class Channel(StrEnum):
    """Connection to the controller."""

    STREAM = "stream"
    """Datagrams of Stream Motion."""
    DOOR = "door"
    """First connection of the Remote Motion Interface, which names the port of the second."""
    SESSION = "session"
    """Second connection of the Remote Motion Interface."""


class Piece(NamedTuple):
    """Datagram or bytes, sent or received on one channel."""

    channel: Channel
    data: bytes


class OpenSession(NamedTuple):
    """Request of the client to open the second connection."""

    port: int


class Ended(NamedTuple):
    """Report to the client that a connection of the Remote Motion Interface has ended, or could not be opened."""

    channel: Channel
    text: str


Pieces: TypeAlias = Sequence[Piece | OpenSession | Ended]
