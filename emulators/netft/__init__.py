"""Emulated ATI Net F/T: its records over UDP and its pages over HTTP."""

from emulators.netft.box import NetBox
from emulators.netft.faults import NETFT_FAULTS
from emulators.netft.page import PageEndpoint, answer
from emulators.netft.profile import NetFtProfile

__all__ = ["NETFT_FAULTS", "NetBox", "NetFtProfile", "PageEndpoint", "answer"]
