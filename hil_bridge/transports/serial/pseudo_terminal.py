"""Pseudo-terminal that a client opens as if it were a serial port."""

import os
import termios
import tty
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from hil_bridge.clock import Clock
from hil_bridge.errors import TransportBroken, TransportError
from hil_bridge.transports import reasons
from hil_bridge.transports.serial.files import FileWire
from hil_bridge.transports.serial.open_count import OpenCount
from hil_bridge.transports.serial.uart import LineSettings

BAUDRATES = {
    getattr(termios, name): int(name[1:])
    for name in dir(termios)
    if name[0] == "B" and name[1:].isdigit() and name != "B0"
}
"""Baud rates by their termios constants."""


class PseudoTerminal:
    """Master side of a pseudo-terminal as a transport. `device` is the file for the client.

    The slave side is kept open as well, so that clients may open and close the device without an end of file on the
    master side. Like a UART, it discards data that arrive while no client has the device open, and data that the
    last client has not read when it closes the device. Bytes sent to a client that does not read are lost once the
    buffers are full. `lost` counts the bytes that were not delivered to the device.
    """

    def __init__(self, clock: Clock, link: Path | None = None, line: LineSettings | None = None) -> None:
        """Create a pseudo-terminal. `line` contains the settings for a client that does not set any. Raises
        TransportUnavailable if no pseudo-terminal is available or the link cannot be created.
        """
        name = f"pty:{link or ''}"
        try:
            owner = _Master(link, name, None if line is None else line.baudrate)
        except OSError as error:
            raise reasons.unavailable("pty", name, str(link or ""), error) from error
        self.device = str(link) if link is not None else owner.device
        self._clock = clock
        self._owner = owner
        self._wire = FileWire(f"pty:{self.device}", owner, clock)
        self.lost = 0
        """Number of sent bytes that no client will read."""

    @property
    def name(self) -> str:
        return self._wire.name

    @property
    def baudrate(self) -> int | None:
        """Baud rate that the client has set, or None if it is not a standard rate.

        The baud rate is the only line setting that can be read: Linux clears the parity flag of a pseudo-terminal,
        so the client's parity is unknown here.
        """
        return self._owner.baudrate()

    def start(self, on_data: Callable[[bytes], None], on_end: Callable[[TransportError], None]) -> None:
        self._wire.start(on_data, on_end)
        self._owner.users.watch(self._clock.loop, self._forget)

    def _forget(self) -> None:
        self._wire.forget()
        self._owner.forget()

    def send(self, data: bytes) -> None:
        if not self._owner.is_in_use():
            self.lost += len(data)
            return
        try:
            self._wire.send(data)
        except TransportError as error:
            if type(error) is not TransportError:
                raise
            self.lost += len(data)

    async def aclose(self) -> None:
        await self._wire.aclose()


class _Master:
    """Files of a pseudo-terminal and its link."""

    def __init__(self, link: Path | None, name: str, baudrate: int | None) -> None:
        self._name = name
        self._link = link
        self.fd, self._slave = os.openpty()
        try:
            tty.setraw(self._slave)
            self._set_baudrate(baudrate)
            os.set_blocking(self.fd, False)
            self.device = os.ttyname(self._slave)
            self.users = OpenCount(self.device)
            """Count of clients that have the device open."""
            if link is not None:
                if link.is_symlink():
                    link.unlink()
                link.symlink_to(self.device)
        except BaseException:
            if hasattr(self, "users"):
                self.users.close()
            os.close(self.fd)
            os.close(self._slave)
            raise

    def _set_baudrate(self, baudrate: int | None) -> None:
        for constant, rate in BAUDRATES.items():
            if rate == baudrate:
                settings = termios.tcgetattr(self._slave)
                settings[4] = settings[5] = constant
                termios.tcsetattr(self._slave, termios.TCSANOW, settings)

    def baudrate(self) -> int | None:
        try:
            return BAUDRATES.get(termios.tcgetattr(self.fd)[5])
        except termios.error:
            return None

    def is_in_use(self) -> bool:
        """Return whether a client has the device open at present. Return True if this is unknown."""
        self.users.update()
        return self.users.count is None or self.users.count > 0

    def forget(self) -> None:
        """Flush the data that no client has read, in both buffers."""
        with suppress(termios.error):
            termios.tcflush(self.fd, termios.TCOFLUSH)
            termios.tcflush(self._slave, termios.TCIFLUSH)

    def unsent(self) -> bool:
        return False

    def close(self) -> None:
        self.users.close()
        if self._link is not None:
            with suppress(OSError):
                if os.readlink(self._link) == self.device:
                    self._link.unlink()
        os.close(self.fd)
        os.close(self._slave)

    def at_end(self) -> TransportError:
        return TransportBroken(f"{self._name}: broke: the pseudo-terminal is gone")

    def broken(self, error: OSError) -> TransportError:
        return reasons.broken("pty", self._name, self.device, error)
