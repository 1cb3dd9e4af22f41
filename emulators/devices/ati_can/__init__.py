"""Emulated ATI NETCANOEM board."""

from emulators.devices.ati_can.board import AtiCanBoard
from emulators.devices.ati_can.faults import ATI_CAN_FAULTS
from emulators.devices.ati_can.profile import AtiCanProfile

__all__ = ["ATI_CAN_FAULTS", "AtiCanBoard", "AtiCanProfile"]
