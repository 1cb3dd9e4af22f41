"""Emulated KUKA controller with the Robot Sensor Interface."""

from emulators.devices.rsi.controller import RsiController
from emulators.devices.rsi.faults import RSI_FAULTS
from emulators.devices.rsi.panel import RSI_CONTROLS
from emulators.devices.rsi.profile import RsiProfile

__all__ = ["RSI_CONTROLS", "RSI_FAULTS", "RsiController", "RsiProfile"]
