"""CAN bus in memory, in real or virtual time."""

from collections.abc import Sequence

from hil_bridge.clock import Clock
from hil_bridge.clock.per_loop import of_loop
from hil_bridge.errors import ConfigError
from hil_bridge.transports.can.memory.bus import BITRATE, MemoryCanBus
from hil_bridge.transports.can.memory.confinement import ErrorCounters
from hil_bridge.transports.can.memory.disturbance import BitErrors, Disturbance
from hil_bridge.transports.can.memory.node import MemoryCanNode
from protocol.can.frame import CanFilter

__all__ = [
    "BitErrors",
    "Disturbance",
    "ErrorCounters",
    "MemoryCanBus",
    "MemoryCanNode",
    "join_memory_can",
    "memory_can_bus",
]


def _buses(clock: Clock) -> dict[str, MemoryCanBus]:
    """Return the buses of this loop by name."""
    return of_loop(clock.loop, dict, "buses of CAN")


def join_memory_can(
    name: str, bitrate: int | None, clock: Clock, accept: Sequence[CanFilter] = ()
) -> MemoryCanNode:
    """Connect a node to the bus of this name in this loop. The first node creates the bus and sets its bit rate.

    Raises ConfigError if the bus exists with another bit rate.
    """
    buses = _buses(clock)
    bus = buses.get(name)
    if bus is None or bus.empty:
        bus = buses[name] = MemoryCanBus(clock, bitrate or BITRATE, f"can+memory:{name}")
    elif bitrate is not None and bitrate != bus.bitrate:
        raise ConfigError(f"{bus.name}: bitrate={bitrate}, but this bus has {bus.bitrate}")
    return bus.connect(accept)


def memory_can_bus(name: str, clock: Clock) -> MemoryCanBus:
    """Return the bus of this name, to read its load or to disturb it. Raises ConfigError if the bus has no nodes."""
    bus = _buses(clock).get(name)
    if bus is None or bus.empty:
        raise ConfigError(f"can+memory:{name}: this bus has no nodes; open a node first")
    return bus
