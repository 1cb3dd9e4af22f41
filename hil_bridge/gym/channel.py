"""Channel between two processes of one computer: a pair of sockets that carry pickled messages."""

import os
import pickle
import socket
import struct
from contextlib import suppress
from typing import Any

_LENGTH = struct.Struct("!Q")


class Channel:
    """One end of a channel. It reads exactly one message at a time, so that processes may share an end in turns."""

    def __init__(self, end: socket.socket) -> None:
        self._end = end
        self._owner = os.getpid()

    def send(self, message: object) -> None:
        """Send a message. Raises OSError if the other end is closed."""
        data = pickle.dumps(message, pickle.HIGHEST_PROTOCOL)
        self._end.sendall(_LENGTH.pack(len(data)) + data)

    def receive(self) -> Any:
        """Wait for a message. Raises EOFError or OSError if the other end is closed."""
        (length,) = _LENGTH.unpack(self._read(_LENGTH.size))
        return pickle.loads(self._read(length))

    def _read(self, length: int) -> bytes:
        data = self._end.recv(length, socket.MSG_WAITALL)
        while len(data) < length:
            part = self._end.recv(length - len(data))
            if not part:
                raise EOFError("the other end of the channel is closed")
            data += part
        return data

    @property
    def is_open(self) -> bool:
        """Whether this end has not been closed."""
        return self._end.fileno() != -1

    @property
    def is_ours(self) -> bool:
        """Whether this process created this end. Otherwise it is a copy in a process that was forked later."""
        return os.getpid() == self._owner

    def close(self) -> None:
        """Close the channel, for copies of this end too. A copy closes nothing but itself. Idempotent."""
        if self.is_open and self.is_ours:
            with suppress(OSError):  # the other end closed it first
                self._end.shutdown(socket.SHUT_RDWR)
        self.drop()

    def drop(self) -> None:
        """Close this end only; copies of it stay open."""
        self._end.close()
