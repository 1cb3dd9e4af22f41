"""Counts of datagram wires, and the size limit."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from hil_bridge.errors import TransportError
from hil_bridge.transports.base import Datagrams

LARGEST_BYTES = 65_507
"""Maximum payload of a datagram, bytes: 65535 minus the headers of IPv4 (20) and UDP (8). Source: RFC 768, RFC 791."""

QUEUE_DATAGRAMS = 1024
"""Maximum length of every queue, datagrams. Chosen: 0.15 s of the fastest sensor's stream, 7000 per second."""


@dataclass(frozen=True, slots=True)
class DatagramStatistics:
    """Counts of one end of a datagram wire since it was opened, in datagrams unless noted otherwise."""

    sent: int = 0
    """Datagrams sent."""
    received: int = 0
    """Datagrams received and accepted."""
    dropped: int = 0
    """Datagrams dropped before sending because the network had no room or the other side had not sent anything yet."""
    unreachable: int = 0
    """Number of network reports that a datagram could not reach its destination."""
    strangers: int = 0
    """Datagrams that arrived from strangers while a peer was in use."""
    refused: int = 0
    """Datagrams of strangers that were refused."""
    overruns: int = 0
    """Datagrams that were lost because they were not read in time."""
    lost: int = 0
    """Datagrams that an emulated network lost on the path of this end; unknown for a real network."""
    duplicated: int = 0
    """Duplicates that an emulated network produced on the path of this end; unknown for a real network."""


class DatagramWire(Protocol):
    """`Transport[Datagrams]` with statistics."""

    @property
    def name(self) -> str:
        """URL from which the wire was opened, for messages."""

    @property
    def statistics(self) -> DatagramStatistics:
        """Counts since opening."""

    def start(self, on_data: Callable[[Datagrams], None], on_end: Callable[[TransportError], None]) -> None:
        """Start delivery; see `Transport.start`. Each received datagram is a `protocol.datagram.Datagram` with its
        arrival time.
        """

    def send(self, data: Datagrams) -> None:
        """Send each datagram without blocking. Datagrams for which the network has no room are dropped and counted.

        Raises TransportError, and sends none of them, if one is too large or the wire has ended.
        """

    def introduce(self, side: Any) -> None:
        """Let a listening wire send to a side that has not sent to it: to an address in the form of `Datagram.side`,
        host and port on UDP, the listener's name in memory.
        """

    def take_in(self) -> None:
        """Deliver the contents of the operating system's receive buffer now, before the event loop does."""

    async def aclose(self) -> None:
        """Close the wire; see `Transport.aclose`."""


def check_sizes(name: str, data: Datagrams) -> None:
    """Raise TransportError for a datagram that is too large for any network."""
    for datagram in data:
        if len(datagram) > LARGEST_BYTES:
            raise TransportError(
                f"{name}: a datagram of {len(datagram)} bytes is too large; at most {LARGEST_BYTES} can be sent"
            )
