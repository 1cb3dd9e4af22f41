"""Datagram wires: UDP, and a network in memory with delay, loss, duplicates and reordering.

A datagram wire is unreliable: a datagram arrives complete or not at all, possibly twice, possibly after a later
one. Losses are counted if they can be detected. The end of the other side is not visible; time limits of the layers
above handle silence.
"""

from hil_bridge.transports.datagram.memory import MemoryDatagrams, Path, connect_memory, listen_memory
from hil_bridge.transports.datagram.peer import Peer
from hil_bridge.transports.datagram.statistics import LARGEST_BYTES, DatagramStatistics, DatagramWire
from hil_bridge.transports.datagram.udp import UdpWire, connect_udp, listen_udp

__all__ = [
    "LARGEST_BYTES",
    "DatagramStatistics",
    "DatagramWire",
    "MemoryDatagrams",
    "Path",
    "Peer",
    "UdpWire",
    "connect_memory",
    "connect_udp",
    "listen_memory",
    "listen_udp",
]
