"""Programs that run in the controller, their watchdogs, and their messages."""

from collections import deque
from collections.abc import Callable
from typing import NamedTuple, Protocol

from emulators.devices.rtde.urscript import Message, Socket
from emulators.devices.rtde.urscript.limits import MESSAGES_MAX


class Program(Protocol):
    """A program that plays."""

    name: str

    def cycle(self) -> bool:
        """Act for one cycle; False once it has ended."""


class Watchdog:
    """A program's demand that an input comes often enough."""

    def __init__(self, name: str, period: float, action: str, now: float) -> None:
        """`period` is the longest time between two packages with the input, s; `action` is pause or stop."""
        self.name, self.period, self.action = name, period, action
        self.last = now


class Saying(NamedTuple):
    """A message of a program, or about it."""

    at: float
    """s"""
    message: Message
    text: str


def _no_server(address: str, port: int) -> Socket | None:
    """No network is emulated."""
    return None


class Console:
    """Messages of programs, the newest, and the network that they see."""

    def __init__(self) -> None:
        self.sayings: deque[Saying] = deque(maxlen=MESSAGES_MAX)
        self.listener: Callable[[Saying], object] | None = None
        """Called with each message at once."""
        self.open_socket: Callable[[str, int], Socket | None] = _no_server
        """Opens a connection to an address and a port. Set by the one that serves the controller."""

    def tell(self, at: float, message: Message, text: str) -> None:
        """A program says something."""
        saying = Saying(at, message, text)
        self.sayings.append(saying)
        if self.listener is not None:
            self.listener(saying)
