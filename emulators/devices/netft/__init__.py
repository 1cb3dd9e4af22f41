"""Emulated ATI Net F/T: its records over UDP and its pages over HTTP."""

from emulators.devices.netft.box import NetBox
from emulators.devices.netft.faults import NETFT_FAULTS
from emulators.devices.netft.page import PageEndpoint, answer
from emulators.devices.netft.profile import NetFtProfile

__all__ = ["NETFT_FAULTS", "NetBox", "NetFtProfile", "PageEndpoint", "answer"]
