"""Emulated Robotiq FT 300, on its serial line and behind the maker's URCap."""

from emulators.devices.ft300.faults import FT300_FAULTS, URCAP_FAULTS
from emulators.devices.ft300.profile import Ft300Profile
from emulators.devices.ft300.sensor import Ft300
from emulators.devices.ft300.urcap import UrcapServer

__all__ = ["FT300_FAULTS", "URCAP_FAULTS", "Ft300", "Ft300Profile", "UrcapServer"]
