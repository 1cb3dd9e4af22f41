"""Serial port by means of pyserial. The event loop reads and writes it without blocking."""

import asyncio
import os.path
import termios
from contextlib import suppress

import serial

from hil_bridge.clock import Clock
from hil_bridge.errors import TransportBroken, TransportError
from hil_bridge.transports import reasons
from hil_bridge.transports.serial.files import FileWire
from hil_bridge.transports.serial.uart import LineSettings, Parity

PSEUDO_TERMINALS = ("/dev/pts/", "/dev/ttyp")


async def open_serial_port(device: str, line: LineSettings, clock: Clock, name: str) -> FileWire:
    """Open a serial port exclusively, with low latency if the driver supports it.

    On a pseudo-terminal no parity is set: it has no line for a parity bit, and Linux refuses the setting with
    EINVAL the second time. Raises TransportUnavailable if the port cannot be opened.
    """
    try:
        port = await asyncio.to_thread(_open, device, line)
    except (OSError, ValueError, termios.error) as error:
        raise reasons.unavailable("serial", name, device, error) from error
    return FileWire(name, _SerialPort(port, name), clock)


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


class _SerialPort:
    """File of a serial port."""

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
