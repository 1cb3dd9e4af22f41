"""Read a measuring card through Linux's comedi drivers, like any program: `/dev/comedi0` and its ioctls.

Numbers and structures are from the kernel's user header linux/comedi.h.
"""

import ctypes
import fcntl
import os
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple, Self

_READ_DIRECTION = 2
"""Direction bits of all requests used here. Source: asm-generic/ioctl.h."""
_DEVINFO, _SUBDINFO, _CHANINFO, _RANGEINFO, _INSN = 1, 2, 3, 8, 12
_INSN_READ = 0x4000000
_NAME_BYTES = 20


class _DeviceInfo(ctypes.Structure):
    _fields_ = (
        ("version", ctypes.c_uint),
        ("subdevices", ctypes.c_uint),
        ("driver", ctypes.c_char * _NAME_BYTES),
        ("board", ctypes.c_char * _NAME_BYTES),
        ("read_subdevice", ctypes.c_int),
        ("write_subdevice", ctypes.c_int),
        ("unused", ctypes.c_int * 30),
    )


class _SubdeviceInfo(ctypes.Structure):
    _fields_ = (
        ("type", ctypes.c_uint),
        ("channels", ctypes.c_uint),
        ("flags", ctypes.c_uint),
        ("others", ctypes.c_uint * 15),
    )


class _ChannelInfo(ctypes.Structure):
    _fields_ = (
        ("subdevice", ctypes.c_uint),
        ("maxima", ctypes.POINTER(ctypes.c_uint)),
        ("flags", ctypes.POINTER(ctypes.c_uint)),
        ("range_types", ctypes.POINTER(ctypes.c_uint)),
        ("unused", ctypes.c_uint * 4),
    )


class _Range(ctypes.Structure):
    _fields_ = (("least", ctypes.c_int), ("most", ctypes.c_int), ("flags", ctypes.c_uint))


class _RangeInfo(ctypes.Structure):
    _fields_ = (("range_type", ctypes.c_uint), ("range", ctypes.POINTER(_Range)))


class _Instruction(ctypes.Structure):
    _fields_ = (
        ("instruction", ctypes.c_uint),
        ("count", ctypes.c_uint),
        ("data", ctypes.POINTER(ctypes.c_uint)),
        ("subdevice", ctypes.c_uint),
        ("channel", ctypes.c_uint),
        ("unused", ctypes.c_uint * 3),
    )


class Span(NamedTuple):
    """Physical values of the lowest and the highest reading of a channel."""

    least: float
    most: float
    maximum: int
    """Highest reading; the lowest is 0."""

    def value(self, reading: int) -> float:
        """Return the physical value of a reading."""
        return self.least + (self.most - self.least) * reading / self.maximum


class Comedi:
    """First subdevice of a card. Raises OSError, with EAGAIN if the driver has no data."""

    def __init__(self, path: Path) -> None:
        self._descriptor = os.open(path, os.O_RDWR)
        info = _DeviceInfo()
        self._call(_DEVINFO, info)
        self.driver, self.board = info.driver.decode(), info.board.decode()
        subdevices = (_SubdeviceInfo * info.subdevices)()
        self._call(_SUBDINFO, subdevices, ctypes.sizeof(_SubdeviceInfo))
        self.channels: int = subdevices[0].channels
        self._data = ctypes.c_uint()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(OSError):
            os.close(self._descriptor)

    def spans(self) -> list[Span]:
        """Return the span of every channel, in millionths of the driver's unit."""
        maxima, types = (ctypes.c_uint * self.channels)(), (ctypes.c_uint * self.channels)()
        self._call(_CHANINFO, _ChannelInfo(0, maxima, None, types))
        spans = []
        for maximum, range_type in zip(maxima, types, strict=True):
            result = _Range()
            self._call(_RANGEINFO, _RangeInfo(range_type, ctypes.pointer(result)))
            spans.append(Span(result.least, result.most, maximum))
        return spans

    def read(self, channel: int) -> int:
        """Return one reading, 0 … the channel's maximum."""
        self._call(_INSN, _Instruction(_INSN_READ, 1, ctypes.pointer(self._data), 0, channel))
        return self._data.value

    def _call(
        self, number: int, argument: ctypes.Structure | ctypes.Array[_SubdeviceInfo], size: int | None = None
    ) -> None:
        size = ctypes.sizeof(argument) if size is None else size
        fcntl.ioctl(self._descriptor, _READ_DIRECTION << 30 | size << 16 | ord("d") << 8 | number, argument)
