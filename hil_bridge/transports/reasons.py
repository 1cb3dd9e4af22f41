"""One-line messages for exceptions of libraries and of the operating system: what is wrong, where, and what to do."""

import errno
import socket

from hil_bridge.errors import TransportBroken, TransportUnavailable

_PORT_ADVICE = {
    errno.ENOENT: ("there is no such port", "check the cable and `ls /dev/tty*`"),
    errno.ENODEV: ("there is no device behind this port", "check the cable and `ls /dev/tty*`"),
    errno.ENXIO: ("there is no device behind this port", "check the cable and `ls /dev/tty*`"),
    errno.EIO: ("the port does not answer", "unplug the adapter and plug it in again"),
    errno.EACCES: ("no permission", "add yourself to the group dialout and log in again"),
    errno.EPERM: ("no permission", "add yourself to the group dialout and log in again"),
    errno.EBUSY: ("another program holds the port", "`fuser -v {target}` shows which"),
    errno.EAGAIN: ("another program holds the port", "`fuser -v {target}` shows which"),
    errno.ENOTTY: ("this is not a serial port", "check the path"),
}
_CAN_ADVICE = {
    errno.ENODEV: ("there is no such CAN interface", "`ip -details link show` lists the interfaces"),
    errno.ENXIO: ("there is no such CAN interface", "`ip -details link show` lists the interfaces"),
    errno.ENETDOWN: (
        "the CAN interface is down",
        "`sudo ip link set {target} up` (after setting its bitrate)",
    ),
    errno.EAFNOSUPPORT: ("this system has no SocketCAN", "load the kernel module `can_raw`"),
    errno.EPROTONOSUPPORT: ("this system has no SocketCAN", "load the kernel module `can_raw`"),
    errno.EPERM: ("no permission to open the CAN interface", ""),
    errno.EACCES: ("no permission to open the CAN interface", ""),
}
_NET_ADVICE = {
    errno.ECONNREFUSED: ("no program listens there", "start the other side first or check the port number"),
    errno.EHOSTUNREACH: ("the host cannot be reached", "check the address and the cable"),
    errno.ENETUNREACH: ("the network cannot be reached", "check the address and the cable"),
    errno.ETIMEDOUT: ("no answer", "check the address and the cable"),
    errno.ECONNRESET: ("the other side dropped the connection", ""),
    errno.EPIPE: ("the other side dropped the connection", ""),
    socket.EAI_NONAME: ("there is no host with this name", "check the spelling"),
    errno.EADDRINUSE: (
        "another program already listens on this port",
        "`ss -lnp` lists it: stop it, or choose another port",
    ),
    errno.EADDRNOTAVAIL: ("this address is not one of this computer's", ""),
    errno.EACCES: ("no permission", "ports below 1024 need privileges"),
}
_UDP_ADVICE = {
    **_NET_ADVICE,
    errno.EACCES: (
        "no permission: a port below 1024 needs privileges, and a broadcast address cannot be used",
        "",
    ),
    errno.EINVAL: (
        "this computer no longer has the address with which the wire was opened",
        "check its network",
    ),
    errno.EMSGSIZE: ("the datagram is too large for this network", ""),
}
ADVICE = {
    "serial": _PORT_ADVICE,
    "can+slcan": _PORT_ADVICE,
    "pty": _PORT_ADVICE,
    "can+socketcan": _CAN_ADVICE,
    "tcp": _NET_ADVICE,
    "tcp-listen": _NET_ADVICE,
    "udp": _UDP_ADVICE,
}


class BusOff(Exception):
    """Error of a CAN controller that is bus-off because of its errors and did not recover."""

    def __init__(self) -> None:
        super().__init__("the CAN controller is bus-off")


_RESTART = (
    "check bitrate, termination and cable, then restart it (`sudo ip link set {target} type can restart`)"
)


def unavailable(scheme: str, name: str, target: str, error: BaseException) -> TransportUnavailable:
    """Return the error of a wire that could not be opened."""
    fact, remedy = meaning(scheme, target, error)
    return TransportUnavailable(f"{name}: cannot be opened: {fact}", remedy=remedy)


def broken(scheme: str, name: str, target: str, error: BaseException) -> TransportBroken:
    """Return the error of an open wire that failed."""
    fact, remedy = meaning(scheme, target, error)
    return TransportBroken(f"{name}: broke: {fact}", remedy=remedy)


def error_number(error: BaseException | None) -> int | None:
    """Return the operating system's error number, even if a library has wrapped it."""
    while error is not None:
        for attribute in ("errno", "error_code"):
            if isinstance(number := getattr(error, attribute, None), int):
                return number
        if isinstance(error, TimeoutError):
            return errno.ETIMEDOUT
        error = error.__cause__ or error.__context__
    return None


def reason(scheme: str, target: str, error: BaseException) -> str:
    """Return the meaning of an error and a remedy in one line."""
    return "; ".join(filter(None, meaning(scheme, target, error)))


def meaning(scheme: str, target: str, error: BaseException) -> tuple[str, str]:
    """Return the meaning of an error and a remedy; the remedy is "" if there is none."""
    number = error_number(error)
    if number == errno.EBADF:
        return "other code of this process has closed its file", ""
    if number is not None and number in ADVICE.get(scheme, {}):
        fact, remedy = ADVICE[scheme][number]
        return fact, remedy.format(target=target)
    if isinstance(error, BusOff):
        return str(error), _RESTART.format(target=target)
    return " ".join(str(error).split()) or type(error).__name__, ""
