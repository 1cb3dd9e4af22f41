"""Datagram wires: UDP, and a network in memory with delay, loss, duplicates and changed order.

Such a wire is unreliable: a datagram arrives whole or not at all, perhaps twice, perhaps after a later one. What is
lost is counted where that can be known. The other side's end is not seen: silence is the matter of time limits above.
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
