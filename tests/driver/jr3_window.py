"""The emulated receiver board behind plain memory, where a host's driver finds the words of a PCI board.

They lie where Linux's jr3_pci driver has them: one word in the low half of every four bytes from byte 10000h on, and
the reset at byte 60000h.
"""

import mmap
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Final, Self

import numpy as np

from emulators.devices.jr3 import Board
from protocol.devices.jr3.board import REGISTERS, SLOT_WORDS, SLOTS

WINDOW_BYTES: Final = 0x80000
WORDS_AT: Final = 0x10000 // 4
RESET_AT: Final = 0x60000 // 4
"""Where they lie, in units of four bytes. Source: Linux's jr3_pci driver."""
WORDS: Final = REGISTERS["transform0"].address + SLOTS * SLOT_WORDS
"""All that have a name, from 0 on."""
COMMAND: Final = REGISTERS["command_word0"].address

PERIOD_S = 0.01
"""From look to look. Chosen: the driver allows 20 ms for the quickest command."""
NOT_RESET: Final = 0xFFFFFFFF
"""Stands at the reset until the driver writes its 0 there. Chosen."""


class Window:
    """Carries words between a board and the memory, both ways, in a thread of its own while it is entered."""

    def __init__(self, board: Board, memory: mmap.mmap, clock: Callable[[], float] = time.monotonic) -> None:
        self.commands: list[int] = []
        """Those that the driver gave since its last reset."""
        self.resets = 0
        self._board = board
        self._clock = clock
        self._lock = threading.Lock()
        self._cells = np.frombuffer(memory, np.uint32)
        self._words = self._cells[WORDS_AT : WORDS_AT + WORDS]
        self._shown = np.zeros(WORDS, np.uint32)
        """Words that the look before left in the memory."""
        self._ended = threading.Event()
        self._failure: BaseException | None = None
        self._thread = threading.Thread(target=self._serve, name="window", daemon=True)
        self._words[:] = 0
        self._cells[RESET_AT] = NOT_RESET

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        self._thread.join()
        if self._failure is not None:
            raise self._failure

    def at_board(self, action: Callable[[Board, float], None]) -> None:
        """Do something to the board at the present time, and show what came of it."""
        with self._lock:
            now = self._clock()
            action(self._board, now)
            self._look(now)

    def look(self) -> None:
        """Hand the driver's words to the board, then show the board's words to the driver."""
        with self._lock:
            self._look(self._clock())

    def _serve(self) -> None:
        try:
            while not self._ended.wait(PERIOD_S):
                self.look()
        except BaseException as failure:  # told by the thread that entered
            self._failure = failure

    def _look(self, now: float) -> None:
        if self._cells[RESET_AT] != NOT_RESET:
            self._cells[RESET_AT] = NOT_RESET
            self.resets += 1
            self.commands.clear()
            self._board.reset(now)
        # The driver writes a command last: once it is seen, the words that belong to it are there.
        command = self._words[COMMAND]
        seen = self._words.copy()
        seen[COMMAND] = command
        written = np.flatnonzero(seen != self._shown).tolist()
        for address in sorted(written, key=lambda address: address == COMMAND):
            self._board.write_word(address, int(seen[address]) & 0xFFFF, now)
        if COMMAND in written:
            self.commands.append(int(command) & 0xFFFF)
        told = np.array(self._board.read(0, WORDS, now), np.uint32)
        # No other words are touched: the driver may have written them since. A command's answer comes last.
        changed = np.flatnonzero(told != seen).tolist()
        for address in sorted(changed, key=lambda address: address == COMMAND):
            self._words[address] = told[address]
        self._shown = told


def mapped(resource: Path) -> mmap.mmap:
    """The memory of a PCI device, through the resource file that Linux shows of it."""
    with resource.open("r+b", buffering=0) as file:
        return mmap.mmap(file.fileno(), WINDOW_BYTES)
