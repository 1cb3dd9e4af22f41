"""An emulated KUKA controller with the Robot Sensor Interface."""

from emulators.rsi.controller import RsiController
from emulators.rsi.faults import RSI_FAULTS
from emulators.rsi.profile import RsiProfile

__all__ = ["RSI_FAULTS", "RsiController", "RsiProfile"]
