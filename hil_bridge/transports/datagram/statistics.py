"""Counts of every datagram wire, and the size that it refuses."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from hil_bridge.errors import TransportError
from hil_bridge.transports.base import Datagrams

LARGEST_BYTES = 65_507
"""Payload of the largest datagram, bytes: 65535 less the headers of IPv4 (20) and UDP (8). Source: RFC 768, RFC 791."""

QUEUE_DATAGRAMS = 1024
"""Bound of every queue of datagrams. Chosen: 0.15 s of the quickest sensor's stream, 7000 a second."""


@dataclass(frozen=True, slots=True)
class DatagramStatistics:
    """Counts of one end of a datagram wire since it was opened. All are numbers of datagrams but one."""

    sent: int = 0
    """Datagrams that the network has taken."""
    received: int = 0
    """Datagrams that arrived and were taken."""
    dropped: int = 0
    """Datagrams to send that were given up: the network had no room, or the other side has not spoken yet."""
    unreachable: int = 0
    """Number of reports by the network that a datagram could not reach its destination."""
    strangers: int = 0
    """Arrivals of others while a peer is in use."""
    refused: int = 0
    """Datagrams of strangers that were refused."""
    overruns: int = 0
    """Arrivals lost because they were not taken in time."""
    lost: int = 0
    """Datagrams that an emulated network lost on the path of this end; a real one does not tell."""
    duplicated: int = 0
    """Copies that an emulated network made on the path of this end; a real one does not tell."""


class DatagramWire(Protocol):
    """A `Transport[Datagrams]` that counts."""

    @property
    def name(self) -> str:
        """The URL it was opened from, for messages."""

    @property
    def statistics(self) -> DatagramStatistics:
        """Counts since it was opened."""

    def start(self, on_data: Callable[[Datagrams], None], on_end: Callable[[TransportError], None]) -> None:
        """As a `Transport`. Each arrival is a `protocol.datagram.Datagram`, with its time."""

    def send(self, data: Datagrams) -> None:
        """Send each, without blocking. What the network has no room for is given up, and counted.

        Raises TransportError, and sends none, when one is too large or the wire has ended.
        """

    def take_in(self) -> None:
        """Deliver what has arrived and lies in the system's buffer, before the loop comes to it."""

    async def aclose(self) -> None:
        """As a `Transport`."""


def check_sizes(name: str, data: Datagrams) -> None:
    """Raise TransportError for a datagram that is larger than any network carries."""
    for datagram in data:
        if len(datagram) > LARGEST_BYTES:
            raise TransportError(
                f"{name}: a datagram of {len(datagram)} bytes is too large; at most {LARGEST_BYTES} can be sent"
            )
