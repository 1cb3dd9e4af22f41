"""An emulated ABB controller with Externally Guided Motion, and its arm."""

from emulators.egm.controller import EgmController, State
from emulators.egm.faults import EGM_FAULTS
from emulators.egm.profile import EgmArmProfile, EgmProfile

__all__ = ["EGM_FAULTS", "EgmArmProfile", "EgmController", "EgmProfile", "State"]
