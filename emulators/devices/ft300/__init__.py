"""Emulated Robotiq FT 300."""

from emulators.devices.ft300.faults import FT300_FAULTS
from emulators.devices.ft300.profile import Ft300Profile
from emulators.devices.ft300.sensor import Ft300

__all__ = ["FT300_FAULTS", "Ft300", "Ft300Profile"]
