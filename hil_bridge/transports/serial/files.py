"""Byte wire over a file descriptor that the event loop watches: a serial port, pseudo-terminal or socket."""

import os
import select
from collections.abc import Callable
from contextlib import suppress
from typing import Protocol

from hil_bridge.clock import Clock
from hil_bridge.errors import TransportError
from hil_bridge.transports.delivery import QUEUE_BYTES, Delivery

_READ_BYTES = 65536


def hung_up(fd: int) -> bool:
    """Return whether an empty read means the end of the file. On a terminal, an empty read may also mean that the
    data was flushed.
    """
    poll = select.poll()
    poll.register(fd, select.POLLIN)
    return bool(poll.poll(0))


class FileOwner(Protocol):
    """Owner of the file, specific to its type."""

    @property
    def fd(self) -> int:
        """File descriptor, open and non-blocking."""

    def unsent(self) -> bool:
        """Return whether the operating system still holds data that has left the queue of the wire."""

    def close(self) -> None:
        """Close the file without waiting."""

    def at_end(self) -> TransportError:
        """Return the error for a port that has nothing more to read."""

    def broken(self, error: OSError) -> TransportError:
        """Convert an error of the operating system to a TransportError."""


class FileWire:
    """Transport over a file descriptor. It writes at once if possible, otherwise it queues up to QUEUE_BYTES."""

    __slots__ = ("_clock", "_delivery", "_fd", "_open", "_owner", "_queue", "peer")

    def __init__(self, name: str, owner: FileOwner, clock: Clock, peer: str = "") -> None:
        self.peer = peer
        """Host of a client that has connected; "" on any other wire."""
        self._owner = owner
        self._fd = owner.fd
        self._clock = clock
        self._delivery: Delivery[bytes] = Delivery(name, QUEUE_BYTES)
        self._queue = bytearray()
        self._open = True

    @property
    def name(self) -> str:
        return self._delivery.name

    @property
    def queued(self) -> int:
        """Number of bytes that the operating system has not accepted yet."""
        return len(self._queue)

    def start(self, on_data: Callable[[bytes], None], on_end: Callable[[TransportError], None]) -> None:
        # earlier arrivals are in the operating system's buffer
        self._delivery.start(on_data, on_end)
        if self._open:
            self._clock.loop.add_reader(self._fd, self._readable)

    def send(self, data: bytes) -> None:
        delivery = self._delivery
        delivery.check()
        if not data:
            return
        if len(self._queue) + len(data) > QUEUE_BYTES:
            raise TransportError(
                f"{self.name}: the queue of {QUEUE_BYTES} bytes is full; the peer does not read"
            )
        if self._queue:
            self._queue += data
            return
        written = self._write(data)
        if written < len(data):
            if delivery.ended is not None:
                delivery.check()
            self._queue += data[written:]
            self._clock.loop.add_writer(self._fd, self._writable)

    def hold(self, hold: bool) -> None:
        """Stop or resume reading. While reading is stopped, data from the other side wait, and the end of the file
        is not detected.
        """
        if self._open and hold:
            self._clock.loop.remove_reader(self._fd)
        elif self._open:
            self._clock.loop.add_reader(self._fd, self._readable)

    def forget(self) -> None:
        """Discard the data that the operating system has not accepted yet."""
        if self._queue:
            self._queue.clear()
            self._clock.loop.remove_writer(self._fd)

    async def aclose(self) -> None:
        await self._delivery.close(self._drained, self._close)

    async def _drained(self) -> None:
        # the operating system does not report when the last byte was sent
        while self._open and (self._queue or self._owner.unsent()):
            await self._clock.sleep_until(self._clock.now() + 0.002)

    def _readable(self) -> None:
        try:
            data = os.read(self._fd, _READ_BYTES)
        except (BlockingIOError, InterruptedError):
            return
        except OSError as error:
            self._end(self._owner.broken(error))
            return
        if data:
            self._delivery.data(data)
        elif hung_up(self._fd):
            self._end(self._owner.at_end())

    def _writable(self) -> None:
        written = self._write(self._queue)
        if self._open:
            del self._queue[:written]
            if not self._queue:
                self._clock.loop.remove_writer(self._fd)

    def _write(self, data: bytes | bytearray) -> int:
        try:
            return os.write(self._fd, data)
        except (BlockingIOError, InterruptedError):
            return 0
        except OSError as error:
            self._end(self._owner.broken(error))
            return 0

    def _end(self, error: TransportError) -> None:
        self._close()
        self._delivery.end(error)

    def _close(self) -> None:
        if self._open:
            self._open = False
            self._clock.loop.remove_reader(self._fd)
            self._clock.loop.remove_writer(self._fd)
            self._queue.clear()
            with suppress(OSError):  # other code has already closed it
                self._owner.close()
