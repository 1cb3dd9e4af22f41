"""Emulated ABB controller with Externally Guided Motion, and its arm."""

from emulators.devices.egm.controller import EgmController
from emulators.devices.egm.faults import EGM_FAULTS
from emulators.devices.egm.panel import EGM_CONTROLS
from emulators.devices.egm.profile import EgmArmProfile, EgmProfile
from emulators.devices.egm.state import State

__all__ = ["EGM_CONTROLS", "EGM_FAULTS", "EgmArmProfile", "EgmController", "EgmProfile", "State"]
