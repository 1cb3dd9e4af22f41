"""Wires for bytes, CAN frames and datagrams over memory, serial ports, TCP, UDP and python-can, opened by URL."""

from hil_bridge.transports.back_off import Reconnecting
from hil_bridge.transports.base import Datagrams, Frames, Transport
from hil_bridge.transports.can.memory import (
    BitErrors,
    Disturbance,
    ErrorCounters,
    MemoryCanBus,
    MemoryCanNode,
    memory_can_bus,
)
from hil_bridge.transports.can.queue import CanStatistics
from hil_bridge.transports.datagram import DatagramStatistics, DatagramWire
from hil_bridge.transports.listening import Listening
from hil_bridge.transports.memory import memory_pair
from hil_bridge.transports.opening import (
    connect_bytes,
    connect_can,
    connect_datagrams,
    listen_bytes,
    listen_can,
    listen_datagrams,
)
from hil_bridge.transports.serial.line import LineNotices, PacedLine, Uart
from hil_bridge.transports.serial.uart import Damaged, Flaw, LineErrors, LineSettings, Parity
from hil_bridge.transports.serial.usb_adapter import UsbAdapter, UsbAdapterProfile
from hil_bridge.transports.wrappers import Direction, Tap

__all__ = [
    "BitErrors",
    "CanStatistics",
    "Damaged",
    "DatagramStatistics",
    "DatagramWire",
    "Datagrams",
    "Direction",
    "Disturbance",
    "ErrorCounters",
    "Flaw",
    "Frames",
    "LineErrors",
    "LineNotices",
    "LineSettings",
    "Listening",
    "MemoryCanBus",
    "MemoryCanNode",
    "PacedLine",
    "Parity",
    "Reconnecting",
    "Tap",
    "Transport",
    "Uart",
    "UsbAdapter",
    "UsbAdapterProfile",
    "connect_bytes",
    "connect_can",
    "connect_datagrams",
    "listen_bytes",
    "listen_can",
    "listen_datagrams",
    "memory_can_bus",
    "memory_pair",
]
