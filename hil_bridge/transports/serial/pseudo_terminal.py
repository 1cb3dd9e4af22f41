"""Pseudo-terminal that a client opens like a serial port."""

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
    """Master side as a transport; `device` is the file for the client.

    The slave side is kept open too, so that clients may come and go without an end on the master side. Like a UART, it
    discards what arrives while no client has the device open, and what the last client has not read when it closes.
    Bytes sent to a client that does not read are lost once the buffers are full. `lost` counts the bytes that were not
    delivered to the device.
    """

    def __init__(self, clock: Clock, link: Path | None = None, line: LineSettings | None = None) -> None:
        """Set the device to `line` for a client that sets nothing. Raises TransportUnavailable if there is no
        pseudo-terminal left or the link cannot be created.
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
        """Bytes sent that no client will read."""

    @property
    def name(self) -> str:
        return self._wire.name

    @property
    def baudrate(self) -> int | None:
        """Baud rate to which the client has set the device; None if it is not a standard rate.

        Of a line's settings it is the only one that can be read: Linux clears the parity flag of a pseudo-terminal, so
        that a client's parity is unknown here.
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
        """Return whether a client has the device open now; True if unknown."""
        self.users.update()
        return self.users.count is None or self.users.count > 0

    def forget(self) -> None:
        """Flush what no client has read, in both buffers."""
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
