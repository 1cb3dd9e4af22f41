"""Network interface of a SocketCAN bus: its state, and its recovery after an outage.

Behaviour of the kernel (net/can/raw.c): when the interface goes down, every socket bound to it reads ENETDOWN once.
The socket stays bound, and sending fails with ENETDOWN, until the interface is up again. When the interface is
deleted or its adapter is unplugged, the socket reads ENODEV. The socket is then unusable, even if an interface of
the same name returns.
"""

import errno
import fcntl
import os
import socket
import struct
from collections.abc import Callable
from typing import Protocol

import can
from can.interfaces.socketcan import SocketcanBus

LINK_LOST = (errno.ENETDOWN, errno.ENODEV, errno.ENXIO)
"""Error numbers of a socket whose interface is down or gone."""

_SIOCGIFFLAGS = 0x8913
_IFF_UP = 0x1
_IFREQ = struct.Struct("16sH22x")


class Link(Protocol):
    """State of a bus interface that may disappear and return."""

    @property
    def up(self) -> bool:
        """Whether frames can pass."""

    def renew(self, bus: can.BusABC) -> can.BusABC:
        """Return the bus to continue with. If the present bus is unusable, close it and open another one. Raises
        OSError or can.CanError if that fails.
        """


class SocketCanLink:
    """Network interface, identified by its name. `open_bus` opens a socket on it."""

    def __init__(self, channel: str, open_bus: Callable[[], can.BusABC]) -> None:
        self._channel = channel
        self._open_bus = open_bus

    @property
    def up(self) -> bool:
        return interface_up(self._channel) is True

    def renew(self, bus: can.BusABC) -> can.BusABC:
        if isinstance(bus, SocketcanBus) and bus.socket.getsockname()[0] == self._channel:
            # still bound to it; the pending error no longer applies
            bus.socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
            return bus
        renewed = self._open_bus()
        bus.shutdown()
        return renewed


def interface_up(name: str) -> bool | None:
    """Return whether a network interface is up, or None if there is no interface with this name. Linux only."""
    try:
        request = _IFREQ.pack(os.fsencode(name), 0)
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as any_socket:
            answer = fcntl.ioctl(any_socket, _SIOCGIFFLAGS, request)
    except OSError as error:
        if error.errno in (errno.ENODEV, errno.ENXIO):
            return None
        raise
    return bool(_IFREQ.unpack(answer)[1] & _IFF_UP)
