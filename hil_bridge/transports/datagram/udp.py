"""Datagrams over UDP, to a fixed peer or to the last sender.

The socket is bound to one address of this computer and is not connected, so that datagrams of strangers are
received and counted. On Linux, network reports about sent datagrams (ICMP) are in the socket's error queue. They
are counted and reported, but do not end the wire, because a device may be switched on later. Other systems do not
provide them.

References: udp(7), ip(7) IP_RECVERR, ipv6(7) IPV6_RECVERR, socket(7) SO_TIMESTAMPNS and SO_RXQ_OVFL.
"""

import errno
import os
import socket
import struct
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Any, TypeAlias

from hil_bridge.clock import Clock
from hil_bridge.errors import TransportError
from hil_bridge.errors.event_kinds import EventKind
from hil_bridge.transports import reasons
from hil_bridge.transports.back_off import Notice
from hil_bridge.transports.base import Datagrams
from hil_bridge.transports.datagram.peer import Notices, Peer, Presence
from hil_bridge.transports.datagram.statistics import QUEUE_DATAGRAMS, DatagramStatistics, check_sizes
from hil_bridge.transports.delivery import Delivery
from protocol.datagram import Datagram, side_of

Address: TypeAlias = tuple[Any, ...]
"""Host and port as in the socket module; for IPv6, also flow and scope."""

MOST_PER_WAKE_UP = 256
"""Maximum number of reads before other tasks of the event loop run. Chosen: 36 ms of the fastest sensor's stream,
7000 per second.
"""

RECEIVE_BUFFER_BYTES = 1 << 20
"""Receive buffer size requested from the operating system, bytes; its limit may be lower. Chosen: 0.2 s of 7000
datagrams per second, each of which the kernel counts as at least 768 bytes.
"""

_LINUX = sys.platform == "linux"
_SO_TIMESTAMPNS, _SO_RXQ_OVFL = 35, 40
_RECVERR = {socket.AF_INET: (socket.IPPROTO_IP, 11), socket.AF_INET6: (socket.IPPROTO_IPV6, 25)}
"""Level and option of `setsockopt` that enable the error queue. Python does not define them before 3.14."""
_TIMESPEC, _DROPS, _ERROR = struct.Struct("@ll"), struct.Struct("@I"), struct.Struct("@I")
_ANCILLARY = socket.CMSG_SPACE(_TIMESPEC.size) + socket.CMSG_SPACE(_DROPS.size) if _LINUX else 0
_ERROR_ANCILLARY = 512
"""Buffer size for an entry of the error queue, bytes: an error, the address that reported it, time stamp and drop
count.
"""

_NO_ROOM = (errno.EAGAIN, errno.ENOBUFS)
_ON_THE_WAY = frozenset(
    (
        *(errno.ECONNREFUSED, errno.EHOSTUNREACH, errno.ENETUNREACH, errno.ENETDOWN, errno.EHOSTDOWN),
        *(errno.ENOPROTOOPT, errno.EOPNOTSUPP, errno.EPROTO, errno.EMSGSIZE, errno.EACCES, errno.EPERM),
        *(getattr(errno, name) for name in ("ENONET",) if hasattr(errno, name)),
    )
)
"""Error numbers of the network, as opposed to the socket. Source: Linux, icmp_err_convert and the table of ICMPv6."""


async def connect_udp(address: tuple[str, int], clock: Clock, name: str, on_notice: Notice) -> "UdpWire":
    """Open a wire to this host and port, from the address of this computer that has a route to it. Raises
    TransportUnavailable if there is none.
    """
    try:
        family, peer = await _resolve(address, clock)
        with socket.socket(family, socket.SOCK_DGRAM) as route:
            route.connect(peer)  # sends nothing; chooses the address
            here = route.getsockname()
        bound = _bound(family, (here[0], 0, *here[2:]))
    except OSError as error:
        raise reasons.unavailable("udp", name, _text(address), error) from error
    return UdpWire(bound, name, Peer(peer), clock, on_notice)


async def listen_udp(
    address: tuple[str, int], clock: Clock, name: str, on_notice: Notice, peer: Peer[Address]
) -> tuple["UdpWire", str, int]:
    """Open a wire at this address of this computer. Return it with the actual host and port. Raises
    TransportUnavailable if the address cannot be used, or the peer's sender cannot be resolved.
    """
    try:
        family, here = await _resolve(address, clock)
        if peer.sender:
            peer.sender = (await _resolve((peer.sender, 0), clock))[1][0]
        bound = _bound(family, here)
    except OSError as error:
        raise reasons.unavailable("udp", name, _text(address), error) from error
    host, port = bound.getsockname()[:2]
    return UdpWire(bound, name, peer, clock, on_notice), host, port


async def _resolve(address: tuple[str, int], clock: Clock) -> tuple[int, Address]:
    results = await clock.loop.getaddrinfo(*address, type=socket.SOCK_DGRAM)
    return results[0][0], results[0][4]


def _bound(family: int, address: Address) -> socket.socket:
    bound = socket.socket(family, socket.SOCK_DGRAM)
    try:
        bound.setblocking(False)
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
        if _LINUX:
            for level, option in ((socket.SOL_SOCKET, _SO_TIMESTAMPNS), (socket.SOL_SOCKET, _SO_RXQ_OVFL)):
                bound.setsockopt(level, option, 1)
            bound.setsockopt(*_RECVERR[bound.family], 1)
        bound.bind(address)
    except BaseException:
        bound.close()
        raise
    return bound


def _text(address: Address) -> str:
    host, port = address[:2]
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


class UdpWire:
    """Transport of datagrams over a bound, unconnected and non-blocking socket.

    On Linux, the arrival time of a datagram is the kernel's receive time; on other systems, the time at which it
    was read. A datagram for which the system has no room is dropped, because it would be outdated by the time there
    is room again.
    """

    def __init__(
        self, bound: socket.socket, name: str, peer: Peer[Address], clock: Clock, on_notice: Notice
    ) -> None:
        self._socket = bound
        self._peer = peer
        self._clock = clock
        self._notices = Notices(clock.now, on_notice)
        self._presence = Presence(self._notices)
        self._delivery: Delivery[Datagrams] = Delivery(name, QUEUE_DATAGRAMS)
        self.introduce = peer.introduce
        self._buffer = bytearray(1 << 16)
        self._open = True
        self._sent = self._received = self._dropped = self._unreachable = self._overruns = 0

    @property
    def name(self) -> str:
        return self._delivery.name

    @property
    def statistics(self) -> DatagramStatistics:
        """Counts since opening. The kernel reports overruns with the next arrival."""
        return DatagramStatistics(
            sent=self._sent,
            received=self._received,
            dropped=self._dropped,
            unreachable=self._unreachable,
            strangers=self._peer.strangers,
            refused=self._peer.refused,
            overruns=self._overruns,
        )

    def start(self, on_data: Callable[[Datagrams], None], on_end: Callable[[TransportError], None]) -> None:
        # earlier arrivals are in the operating system's buffer
        self._delivery.start(on_data, on_end)
        if self._open:
            self._clock.loop.add_reader(self._socket.fileno(), self._readable)

    def send(self, data: Datagrams) -> None:
        self._delivery.check()
        check_sizes(self.name, data)
        for datagram in data:
            target = self._peer.target(side_of(datagram))
            if target is not None and self._sends(datagram, target):
                self._sent += 1
            else:
                self._dropped += 1

    async def aclose(self) -> None:
        if self._delivery.begin_close():
            self._close()
            self._delivery.closed()

    # --- sending

    def _sends(self, datagram: bytes, target: Address) -> bool:
        """Send a datagram. Return whether the system has accepted it. Raises TransportError if the wire breaks."""
        for _ in range(2):
            try:
                self._socket.sendto(datagram, target)
                return True
            except OSError as error:
                if error.errno in _NO_ROOM:
                    return False
                if error.errno not in _ON_THE_WAY:
                    self._break(error)
                    self._delivery.check()
                failure = error
            if not self._read_errors():
                break
            # the error is about an earlier datagram; this one has not been sent yet
        self._tell_unreachable(failure, target)
        return False

    # --- receiving

    def take_in(self) -> None:
        if self._open:
            self._readable()

    def _readable(self) -> None:
        arrived: list[bytes] = []
        failure: OSError | None = None
        for _ in range(MOST_PER_WAKE_UP):
            try:
                length, ancillary, _, source = self._socket.recvmsg_into([self._buffer], _ANCILLARY)
            except (BlockingIOError, InterruptedError):
                break
            except OSError as error:
                failure = error
                break
            at = self._stamp(ancillary)
            if self._peer.takes(source, self._clock.now()):
                arrived.append(Datagram(memoryview(self._buffer)[:length], at, source))
            else:
                self._notices.tell(
                    EventKind.STRANGER, f"{self.name}: datagrams of {_text(source)} are refused"
                )
        if failure is not None or not arrived:
            reports = self._read_errors()
            if failure is not None and failure.errno in _ON_THE_WAY:
                failure = None
                if not reports and not _LINUX:
                    self._unreachable += 1
        if arrived:
            self._received += len(arrived)
            self._presence.hear()
            self._delivery.data(arrived)
        if failure is not None and self._open:
            self._break(failure)

    def _stamp(self, ancillary: list[tuple[int, int, bytes]]) -> float:
        """Return the arrival time of a datagram, s on the loop's clock. Also count the datagrams for which the
        kernel had no room.
        """
        at = None
        for level, kind, data in ancillary:
            if level != socket.SOL_SOCKET:
                continue
            if kind == _SO_TIMESTAMPNS and len(data) == _TIMESPEC.size:
                seconds, nanoseconds = _TIMESPEC.unpack(data)
                at = self._clock.at_wall(seconds + nanoseconds * 1e-9)
            elif kind == _SO_RXQ_OVFL and len(data) == _DROPS.size:
                (self._overruns,) = _DROPS.unpack(data)
        return self._clock.now() if at is None else at

    def _read_errors(self) -> int:
        """Process the network's reports about sent datagrams. Return their number."""
        if not _LINUX:
            return 0
        for count in range(MOST_PER_WAKE_UP):
            try:
                _, ancillary, _, target = self._socket.recvmsg(0, _ERROR_ANCILLARY, socket.MSG_ERRQUEUE)
            except OSError:
                return count
            for level, kind, data in ancillary:
                if (level, kind) in _RECVERR.values() and len(data) >= _ERROR.size:
                    (number,) = _ERROR.unpack_from(data)
                    self._tell_unreachable(OSError(number, os.strerror(number)), target)
        return MOST_PER_WAKE_UP

    def _tell_unreachable(self, error: OSError, target: Address) -> None:
        self._unreachable += 1
        text = reasons.reason("udp", _text(target), error)
        if error.errno == errno.ECONNREFUSED:
            self._presence.miss(self.name, _text(target), text)
        else:
            self._notices.tell(
                EventKind.UNREACHABLE, f"{self.name}: {_text(target)} cannot be reached: {text}"
            )

    # --- the end

    def _break(self, error: OSError) -> None:
        self._close()
        self._delivery.end(reasons.broken("udp", self.name, self.name, error))

    def _close(self) -> None:
        if self._open:
            self._open = False
            self._clock.loop.remove_reader(self._socket.fileno())
            with suppress(OSError):  # other code has already closed it
                self._socket.close()
