"""Emulated ATI NETCANOEM board."""

from emulators.ati_can.board import AtiCanBoard
from emulators.ati_can.faults import ATI_CAN_FAULTS
from emulators.ati_can.profile import AtiCanProfile

__all__ = ["ATI_CAN_FAULTS", "AtiCanBoard", "AtiCanProfile"]
