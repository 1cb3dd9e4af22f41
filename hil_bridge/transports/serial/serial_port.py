"""A serial port through pyserial, read and written by the event loop without blocking."""

import asyncio
import fcntl
import os.path
import struct
import termios
from collections.abc import Callable
from contextlib import suppress

import serial

from hil_bridge.clock import Clock
from hil_bridge.errors import TransportBroken, TransportError
from hil_bridge.transports import reasons
from hil_bridge.transports.base import Transport
from hil_bridge.transports.serial.files import FileWire
from hil_bridge.transports.serial.uart import LineErrors, LineSettings, Parity

TIOCGICOUNT = 0x545D
COUNTERS = struct.Struct("@20i")
"""Linux's `serial_icounter_struct`: cts, dsr, rng, dcd, rx, tx, frame, overrun, parity, brk, and ten more."""

PSEUDO_TERMINALS = ("/dev/pts/", "/dev/ttyp")


class SerialWire:
    """The transport of a serial port."""

    def __init__(self, wire: Transport[bytes], fd: int) -> None:
        self._wire = wire
        self._fd = fd
        self._open = True
        self._last = LineErrors()
        self._before = self._counted()

    @property
    def name(self) -> str:
        return self._wire.name

    @property
    def line_errors(self) -> LineErrors:
        """Damaged characters since it was opened, as the driver counts them; none where it does not."""
        now, before = self._counted(), self._before
        return LineErrors(
            now.parity - before.parity, now.framing - before.framing, now.breaks - before.breaks
        )

    def start(self, on_data: Callable[[bytes], None], on_end: Callable[[TransportError], None]) -> None:
        def ended(error: TransportError) -> None:
            self._open = False
            on_end(error)

        self._wire.start(on_data, ended)

    def send(self, data: bytes) -> None:
        self._wire.send(data)

    async def aclose(self) -> None:
        self._open = False
        await self._wire.aclose()

    def _counted(self) -> LineErrors:
        """Counts of the driver since it was loaded; the last ones once the port is closed."""
        if self._open:
            with suppress(OSError):
                _, _, _, _, _, _, frame, _, parity, brk, *_ = COUNTERS.unpack(_counters(self._fd))
                self._last = LineErrors(parity, frame, brk)
        return self._last


async def open_serial_port(device: str, line: LineSettings, clock: Clock, name: str) -> SerialWire:
    """Open a serial port for ourselves alone, with low latency where the driver offers it.

    On a pseudo-terminal no parity is set. It has no line on which a parity bit could travel, and Linux refuses the
    setting with EINVAL when it is made twice. Raises TransportUnavailable.
    """
    try:
        port = await asyncio.to_thread(_open, device, line)
    except (OSError, ValueError, termios.error) as error:
        raise reasons.unavailable("serial", name, device, error) from error
    owner = _SerialPort(port, name)
    return SerialWire(FileWire(name, owner, clock), owner.fd)


def _open(device: str, line: LineSettings) -> serial.Serial:
    pseudo = os.path.realpath(device).startswith(PSEUDO_TERMINALS)
    port = serial.Serial(
        device,
        baudrate=line.baudrate,
        parity=(Parity.NONE if pseudo else line.parity).value,
        stopbits=line.stopbits,
        timeout=0,
        write_timeout=0,
        exclusive=True,
    )
    with suppress(OSError, ValueError, AttributeError, NotImplementedError):
        port.set_low_latency_mode(True)
    return port


def _counters(fd: int) -> bytes:
    return fcntl.ioctl(fd, TIOCGICOUNT, bytes(COUNTERS.size))


class _SerialPort:
    """The file behind a serial port."""

    def __init__(self, port: serial.Serial, name: str) -> None:
        self._port = port
        self._name = name
        self.fd: int = port.fileno()

    def unsent(self) -> bool:
        try:
            return bool(self._port.out_waiting)
        except OSError:
            return False

    def close(self) -> None:
        with suppress(OSError, termios.error):
            if self._port.out_waiting:
                # closing would block for half a minute while a peer holds the line
                self._port.reset_output_buffer()
        with suppress(OSError):
            self._port.close()

    def at_end(self) -> TransportError:
        return TransportBroken(
            f"{self._name}: broke: the device is gone", remedy="check the cable and `ls /dev/tty*`"
        )

    def broken(self, error: OSError) -> TransportError:
        return reasons.broken("serial", self._name, self._port.port, error)
