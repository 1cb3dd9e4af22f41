"""Emulated JR3 DSP receiver board."""

from emulators.devices.jr3.board.board import Board
from emulators.devices.jr3.board.profile import BoardProfile

__all__ = ["Board", "BoardProfile"]
