"""The serial port under python-can's slcan interface, without its waits.

python-can reads that port with one system call a byte, ignores how much a write has taken, and waits after
every frame until the last bit has left. It does all this through its `serialPortOrig`, which this replaces.
"""

import errno
import os

import serial

from hil_bridge.transports.delivery import QUEUE_BYTES
from hil_bridge.transports.serial.files import hung_up

_READ_BYTES = 65536


class SlcanPort:
    """Reads in one go, writes what the port takes and queues the rest."""

    write_timeout = 0

    def __init__(self, port: serial.Serial) -> None:
        self._port = port
        self._fd: int = port.fileno()
        self._received = bytearray()
        self._taken = 0
        self.unsent = bytearray()
        """What the port has not taken yet."""
        self.unfinished = 0
        """Length of the line whose end has not come yet."""

    @property
    def in_waiting(self) -> int:
        """Bytes read from the port that python-can has not taken."""
        return len(self._received) - self._taken

    def fill(self) -> None:
        """Read what is there. Raises OSError when the port is gone."""
        try:
            data = os.read(self._fd, _READ_BYTES)
        except (BlockingIOError, InterruptedError):
            return
        if not data and hung_up(self._fd):
            raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))
        last_end = max(data.rfind(b"\r"), data.rfind(b"\a"))
        self.unfinished = len(data) - 1 - last_end + (self.unfinished if last_end < 0 else 0)
        del self._received[: self._taken]
        self._taken = 0
        self._received += data

    def read(self, size: int = 1) -> bytes:
        """The next bytes that were read, or none."""
        data = bytes(self._received[self._taken : self._taken + size])
        self._taken += len(data)
        return data

    def write(self, data: bytes) -> int:
        """Take all or raise BlockingIOError because too much is queued."""
        if len(self.unsent) + len(data) > QUEUE_BYTES:
            raise BlockingIOError("the queue is full")
        self.unsent += data
        self.push()
        return len(data)

    def push(self) -> None:
        """Give the port what it takes. Raises OSError when the port is gone."""
        try:
            del self.unsent[: os.write(self._fd, self.unsent)]
        except (BlockingIOError, InterruptedError):
            return

    def flush(self) -> None:
        """Not to be waited for."""

    def reset_input_buffer(self) -> None:
        """Forget what was read."""
        self._received.clear()
        self._taken = self.unfinished = 0

    def fileno(self) -> int:
        """The file descriptor to watch."""
        return self._fd

    def close(self) -> None:
        """Close the port."""
        self._port.close()
