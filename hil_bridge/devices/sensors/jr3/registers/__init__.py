"""Registers of a receiver board, over a network or of a real board on the PCI bus."""

from hil_bridge.devices.sensors.jr3.registers.pci import (
    DEFAULT_OFFSET,
    SYSFS,
    PciRegisters,
    open_pci,
    read_program,
)
from hil_bridge.devices.sensors.jr3.registers.server import ListenerProfile, RegisterListener
from hil_bridge.devices.sensors.jr3.registers.wires import (
    DEFAULT_PORT,
    ServedBoard,
    Watcher,
    board_wire,
    connect_board,
    serve_board,
)

__all__ = [
    "DEFAULT_OFFSET",
    "DEFAULT_PORT",
    "SYSFS",
    "ListenerProfile",
    "PciRegisters",
    "RegisterListener",
    "ServedBoard",
    "Watcher",
    "board_wire",
    "connect_board",
    "open_pci",
    "read_program",
    "serve_board",
]
