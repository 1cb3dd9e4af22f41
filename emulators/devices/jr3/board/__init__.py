"""The emulated JR3 DSP receiver board and the ISA ports in front of it."""

from emulators.devices.jr3.board.board import Board
from emulators.devices.jr3.board.isa import IsaPorts, IsaProfile
from emulators.devices.jr3.board.profile import BoardProfile

__all__ = ["Board", "BoardProfile", "IsaPorts", "IsaProfile"]
