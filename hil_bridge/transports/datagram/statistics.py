"""Counts of datagram wires, and the size limit."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from hil_bridge.errors import TransportError
from hil_bridge.transports.base import Datagrams

LARGEST_BYTES = 65_507
"""Payload of the largest datagram, bytes: 65535 less the headers of IPv4 (20) and UDP (8). Source: RFC 768, RFC 791."""

QUEUE_DATAGRAMS = 1024
"""Limit of every queue of datagrams. Chosen: 0.15 s of the fastest sensor's stream, 7000 per second."""


@dataclass(frozen=True, slots=True)
class DatagramStatistics:
    """Counts of one end of a datagram wire since opening, in datagrams unless noted."""

    sent: int = 0
    """Datagrams sent."""
    received: int = 0
    """Datagrams received and accepted."""
    dropped: int = 0
    """Datagrams dropped before sending: the network had no room, or the other side has not sent yet."""
    unreachable: int = 0
    """Number of reports by the network that a datagram could not reach its destination."""
    strangers: int = 0
    """Arrivals from strangers while a peer is in use."""
    refused: int = 0
    """Datagrams of strangers that were refused."""
    overruns: int = 0
    """Arrivals lost because they were not read in time."""
    lost: int = 0
    """Datagrams that an emulated network lost on the path of this end; not known for a real one."""
    duplicated: int = 0
    """Copies that an emulated network made on the path of this end; not known for a real one."""


class DatagramWire(Protocol):
    """`Transport[Datagrams]` with statistics."""

    @property
    def name(self) -> str:
        """URL that it was opened from, for messages."""

    @property
    def statistics(self) -> DatagramStatistics:
        """Counts since opening."""

    def start(self, on_data: Callable[[Datagrams], None], on_end: Callable[[TransportError], None]) -> None:
        """As for a `Transport`. Each arrival is a `protocol.datagram.Datagram`, with its time."""

    def send(self, data: Datagrams) -> None:
        """Send each, without blocking. Datagrams for which the network has no room are dropped and counted.

        Raises TransportError, and sends none, if one is too large or the wire has ended.
        """

    def take_in(self) -> None:
        """Deliver what is in the system's receive buffer, before the loop does."""

    async def aclose(self) -> None:
        """As for a `Transport`."""


def check_sizes(name: str, data: Datagrams) -> None:
    """Raise TransportError for a datagram that is too large for any network."""
    for datagram in data:
        if len(datagram) > LARGEST_BYTES:
            raise TransportError(
                f"{name}: a datagram of {len(datagram)} bytes is too large; at most {LARGEST_BYTES} can be sent"
            )
