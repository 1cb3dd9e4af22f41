"""Errors, as a tree by the part at fault. Messages are one line: what, where, what to do."""


class BridgeError(Exception):
    """Every error that a person is meant to read. `exit_code` is what the command line ends with."""

    exit_code = 3


class ConfigError(BridgeError):
    """The configuration, a command-line value or a file that was named is wrong."""

    exit_code = 2


class TransportError(BridgeError):
    """A wire failed. The subclass says which end of it."""


class TransportClosed(TransportError):
    """We closed it."""


class TransportBroken(TransportError):
    """The peer vanished or the cable broke."""


class TransportEnded(TransportError):
    """The other side ended the stream in an orderly way."""


class TransportUnavailable(TransportError):
    """The port, host or interface could not be opened."""


class DeviceError(BridgeError):
    """A device is there but refuses, stays silent or says what it must not."""


class SafetyStop(BridgeError):
    """The supervisor stopped the run; the message is the latched cause."""


class OrderRefused(DeviceError):
    """The robot refused an order; `code` is its own number for the reason, 0 where it tells none."""

    def __init__(self, text: str, code: int = 0) -> None:
        super().__init__(text)
        self.code = code


class GateStop(OrderRefused):
    """The last gate stopped an order, which is a bug of this program; nothing of it was sent."""
