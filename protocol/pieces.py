"""Data of a device that has several connections: each piece names the connection that carries it.

An endpoint with several connections receives and sends sequences of pieces.
"""

from typing import Generic, NamedTuple, TypeVar

Port = TypeVar("Port", bound=str)
Data = TypeVar("Data")


class Piece(NamedTuple, Generic[Port, Data]):
    """Data sent or received on one connection."""

    port: Port
    """Name of the connection."""
    data: Data
    """Data as on a wire of this kind: bytes, or a sequence of datagrams or frames."""
