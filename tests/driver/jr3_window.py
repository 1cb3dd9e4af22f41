"""Emulated receiver board behind plain memory, where a host's driver finds the words of a PCI board.

They are located as Linux's jr3_pci driver expects: one word in the low half of every four bytes from byte 10000h on,
and the reset at byte 60000h.
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
"""Number of named words, from 0 on."""
COMMAND: Final = REGISTERS["command_word0"].address

PERIOD_S = 0.01
"""Update period, s. Chosen: the driver allows 20 ms for the fastest command."""
NOT_RESET: Final = 0xFFFFFFFF
"""Value at the reset address until the driver writes 0 there. Chosen."""


class Window:
    """Copies words between a board and the memory, in both directions, in a separate thread while it is entered."""

    def __init__(self, board: Board, memory: mmap.mmap, clock: Callable[[], float] = time.monotonic) -> None:
        self.commands: list[int] = []
        """Commands from the driver since its last reset."""
        self.resets = 0
        self._board = board
        self._clock = clock
        self._lock = threading.Lock()
        self._cells = np.frombuffer(memory, np.uint32)
        self._words = self._cells[WORDS_AT : WORDS_AT + WORDS]
        self._reported = np.zeros(WORDS, np.uint32)
        """Words that the previous update left in the memory."""
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
        """Do something to the board at the present time, and update the memory."""
        with self._lock:
            now = self._clock()
            action(self._board, now)
            self._exchange(now)

    def exchange(self) -> None:
        """Pass the driver's words to the board, then the board's words to the driver."""
        with self._lock:
            self._exchange(self._clock())

    def _serve(self) -> None:
        try:
            while not self._ended.wait(PERIOD_S):
                self.exchange()
        except BaseException as failure:  # told by the thread that entered
            self._failure = failure

    def _exchange(self, now: float) -> None:
        if self._cells[RESET_AT] != NOT_RESET:
            self._cells[RESET_AT] = NOT_RESET
            self.resets += 1
            self.commands.clear()
            self._board.reset(now)
        # The driver writes a command last: once it is seen, the words that belong to it are there.
        command = self._words[COMMAND]
        observed = self._words.copy()
        observed[COMMAND] = command
        written = np.flatnonzero(observed != self._reported).tolist()
        for address in sorted(written, key=lambda address: address == COMMAND):
            self._board.write_word(address, int(observed[address]) & 0xFFFF, now)
        if COMMAND in written:
            self.commands.append(int(command) & 0xFFFF)
        reported = np.array(self._board.read(0, WORDS, now), np.uint32)
        # No other words are touched: the driver may have written them since. A command's answer comes last.
        changed = np.flatnonzero(reported != observed).tolist()
        for address in sorted(changed, key=lambda address: address == COMMAND):
            self._words[address] = reported[address]
        self._reported = reported


def mapped(resource: Path) -> mmap.mmap:
    """Map the memory of a PCI device through its resource file."""
    with resource.open("r+b", buffering=0) as file:
        return mmap.mmap(file.fileno(), WINDOW_BYTES)
