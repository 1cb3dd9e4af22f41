"""Words of a real JR3 PCI board, accessed through the Linux resource file of the board's memory.

The layout is known from the Linux driver jr3_pci: BAR 0, a block of 0x80000 bytes for each channel, and one word in
the low half of every four bytes. The reset is at byte 0x60000 of the block. The two halves of the program are below
and above the reset.
"""

import errno
import mmap
import os
import re
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from hil_bridge.errors import ConfigError, DeviceError, TransportUnavailable
from hil_bridge.errors.text_files import read_text
from protocol.devices.jr3.board import (
    INSTRUCTIONS,
    MEMORY_WORDS,
    REGISTERS,
    check_instructions,
    check_range,
    pack_words,
)
from protocol.devices.jr3.registers import ProgramWord, ResetRefused
from protocol.endpoint import RemoteProtocolError

SYSFS: Final = Path("/sys/bus/pci/devices")
DEFAULT_OFFSET: Final = 0x18000
"""Byte offset at which the words of a channel begin. Observed: this is the value of the manual; the kernel's driver
uses 0x10000.
"""

_VENDOR = 0x1762
_CHANNELS = {0x1111: 1, 0x3111: 1, 0x3112: 2, 0x3113: 3, 0x3114: 4}
"""Number of channels by PCI device number."""
_BLOCK_BYTES = 0x80000
_PROGRAM_LOW, _PROGRAM_HIGH, _RESET = 0x00000 // 4, 0x40000 // 4, 0x60000 // 4
_WORDS_END = 0x40000
"""Byte offset at which the words end and the upper half of the program begins."""
_ADDRESS = re.compile(r"(?:([0-9a-fA-F]{4}):)?([0-9a-fA-F]{2}:[0-9a-fA-F]{2}\.[0-7])")
_LIST = "`lspci -d 1762:` lists the boards"


class PciRegisters:
    """Words of one channel. A burst is not an atomic snapshot, because the bus reads its words one by one."""

    def __init__(self, memory: mmap.mmap, name: str, offset: int, program: tuple[ProgramWord, ...]) -> None:
        self.name = name
        self._mapping = memory
        # Accesses are complete 32-bit words; the bus transfers the low 16 bits. Board and hosts are little-endian.
        self._memory = memoryview(memory).cast("I")
        self._first = offset // 4
        self._size = min(MEMORY_WORDS, (_WORDS_END - offset) // 4)
        self._program = program

    @property
    def text(self) -> str:
        """Copyright text of the board. Any other text means that the offset or the program is wrong."""
        register = REGISTERS["copyright"]
        words = self.read(register.address, register.count)
        text = "".join(chr(word >> 8) for word in words if 0x20 <= word >> 8 < 0x7F)
        return " ".join(text.split())

    def read(self, address: int, count: int, now: float = 0.0) -> tuple[int, ...]:
        """Return words in order of address. Raises RemoteProtocolError for an address outside the memory."""
        begin = self._begin(address, count)
        return tuple([word & 0xFFFF for word in self._memory[begin : begin + count]])

    def burst(self, address: int, count: int, now: float = 0.0) -> bytes:
        """Return words in the encoding of the wire. Raises RemoteProtocolError for an address outside the memory."""
        return pack_words(self.read(address, count))

    def write(self, address: int, words: Sequence[int], now: float = 0.0) -> None:
        """Write words in order of address. Raises RemoteProtocolError for an address outside the memory."""
        begin = self._begin(address, len(words))
        for place, word in enumerate(words, begin):
            self._memory[place] = word

    def reset(self, now: float = 0.0) -> None:
        """Reset the processor and load its program, as the Linux driver does.

        Raises ResetRefused if no program is available, because the processor waits for a program after a reset.
        """
        if not self._program:
            raise ResetRefused(
                f"{self.name}: no program file was given; a board needs its program after a reset"
            )
        self.load(0, ())
        for word in self._program:
            self.load(word.address, (word.low, word.high))

    def load(self, address: int, words: Sequence[int], now: float = 0.0) -> None:
        """Write instructions, or reset the processor before a program is written if `words` is empty. Raises
        RemoteProtocolError for an address outside the program memory.
        """
        check_instructions(address, words)
        if not words:
            self._memory[_RESET] = 0
        for place, (low, high) in enumerate(zip(words[::2], words[1::2], strict=True), address):
            self._memory[_PROGRAM_LOW + place] = low
            self._memory[_PROGRAM_HIGH + place] = high

    def close(self) -> None:
        """Release the memory. Idempotent."""
        self._memory.release()
        self._mapping.close()

    def _begin(self, address: int, count: int) -> int:
        check_range(address, count)
        if address + count > self._size:
            raise RemoteProtocolError(f"{count} words from {address:#06x} are not within the channel's block")
        return self._first + address


def open_pci(
    address: str,
    channel: int = 0,
    offset: int = DEFAULT_OFFSET,
    program: tuple[ProgramWord, ...] = (),
    sysfs: Path = SYSFS,
) -> PciRegisters:
    """Open a board's channel.

    Raises ConfigError for an invalid address, channel or offset, TransportUnavailable if the board cannot be opened,
    DeviceError if the device is not a JR3 board.
    """
    match = _ADDRESS.fullmatch(address)
    if match is None:
        raise ConfigError(f"--pci: must be an address such as 0000:03:00.0, got {address!r}; {_LIST}")
    if offset % 4 or not 0 <= offset < _WORDS_END:
        raise ConfigError(f"--offset: must be a multiple of 4 below {_WORDS_END:#x}, got {offset:#x}")
    place = f"{match[1] or '0000'}:{match[2]}".lower()
    name, folder = f"PCI device {place}", sysfs / place
    if not folder.is_dir():
        raise TransportUnavailable(f"{name} does not exist; {_LIST}")
    vendor, device = _number(folder / "vendor", name), _number(folder / "device", name)
    if vendor != _VENDOR or device not in _CHANNELS:
        raise DeviceError(f"{name} is {vendor:04x}:{device:04x}, not a JR3 board; {_LIST}")
    if not 0 <= channel < _CHANNELS[device]:
        channels = ", ".join(map(str, range(_CHANNELS[device])))
        raise ConfigError(
            f"--channel: must be one of {channels} on this board (1762:{device:04x}), got {channel}"
        )
    with suppress(OSError):  # missing for a simulated board
        if (folder / "enable").read_text().strip() == "0":
            raise DeviceError(
                f"{name} is disabled; run `echo 1 | sudo tee {folder}/enable`, or load its driver"
            )
    return PciRegisters(_map(folder / "resource0", name, channel), name, offset, program)


def read_program(path: Path) -> tuple[ProgramWord, ...]:
    """Read the board's program from JR3's file (jr3pci.idm): hexadecimal count, address and words, until ffff.

    Raises ConfigError.
    """
    text = read_text(path, encoding="ascii")
    numbers = iter([int(word, 16) for word in re.findall(r"[0-9a-fA-F]+", text)])
    program: list[ProgramWord] = []
    try:
        while (count := next(numbers)) != 0xFFFF:
            address = next(numbers)
            words = [next(numbers) for _ in range(count)]
            if address & 0x4000:
                continue  # data, which the driver does not load either
            if count % 2 or address + count // 2 > INSTRUCTIONS or max(words, default=0) > 0xFFFF:
                raise ConfigError(f"{path} is not a board program: {count} words for {address:#06x}")
            pairs = zip(words[::2], words[1::2], strict=True)
            program += [ProgramWord(address + i, low, high) for i, (low, high) in enumerate(pairs)]
    except StopIteration:
        raise ConfigError(f"{path} is not a board program: it has no end mark ffff") from None
    if not program:
        raise ConfigError(f"{path} is not a board program: it is empty")
    return tuple(program)


def _number(path: Path, name: str) -> int:
    try:
        return int(path.read_text(), 16)
    except (OSError, ValueError) as error:
        raise TransportUnavailable(f"{name}: cannot read its type from {path}") from error


def _map(path: Path, name: str, channel: int) -> mmap.mmap:
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_SYNC)
    except OSError as error:
        raise _unavailable(error, path, name) from error
    try:
        size, needed = os.fstat(descriptor).st_size, (channel + 1) * _BLOCK_BYTES
        if size < needed:
            raise DeviceError(
                f"{name}: {path} has {size} bytes, channel {channel} needs {needed}: not a JR3 board's memory"
            )
        return mmap.mmap(descriptor, _BLOCK_BYTES, offset=channel * _BLOCK_BYTES)
    except OSError as error:
        raise _unavailable(error, path, name) from error
    finally:
        os.close(descriptor)


def _unavailable(error: OSError, path: Path, name: str) -> TransportUnavailable:
    advice = {
        errno.EACCES: f"no permission; run as root, or `sudo chown $USER {path}`",
        errno.EPERM: "the kernel forbids it; its driver may hold the board: `sudo modprobe -r jr3_pci`",
        errno.EINVAL: "the kernel forbids it; its driver may hold the board: `sudo modprobe -r jr3_pci`",
        errno.ENOENT: "it has no memory to map; check that it is a JR3 board and that the kernel has initialized it",
    }
    reason = advice.get(error.errno or 0) or error.strerror
    return TransportUnavailable(f"{name}: {path} cannot be opened: {reason}")
