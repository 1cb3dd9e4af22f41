"""Programs that run in the controller, their watchdogs, and their messages."""

from collections import deque
from collections.abc import Callable
from typing import NamedTuple, Protocol

from emulators.devices.rtde.urscript import Message, Socket
from emulators.devices.rtde.urscript.limits import MESSAGES_MAX
from protocol.devices.rtde.states import SafetyMode


class Program(Protocol):
    """A program that plays."""

    name: str

    def cycle(self) -> bool:
        """Act for one cycle; False once it has ended."""

    def close(self) -> None:
        """Stop the program."""


class Watchdog:
    """A program's demand that an input comes often enough."""

    def __init__(self, name: str, period: float, action: str, now: float) -> None:
        """`period` is the longest time between two packages with the input, s; `action` is pause or stop."""
        self.name, self.period, self.action = name, period, action
        self.last = now
        """Time of the newest package, s."""

    def is_overdue(self, now: float) -> bool:
        """Whether the input has not come for too long."""
        return now - self.last > self.period + 1e-9


class Saying(NamedTuple):
    """A message of a program, or about it."""

    at: float
    """s"""
    message: Message
    text: str
    """Of a program that starts or stops, its name."""
    title: str = ""
    """Of a pop-up."""
    line: int = 0
    """Of an error, 1 and more."""
    column: int = 0

    def __str__(self) -> str:
        place = f", column {self.column}" if self.message is Message.SYNTAX else ""
        return f"{self.message} in line {self.line}{place}: {self.text}" if self.line else self.text


class Listener(Protocol):
    """Hears each message at once."""

    def hear(self, saying: Saying) -> None:
        """Report a message of a program, or about one."""

    def hear_safety(self, mode: SafetyMode) -> None:
        """Another safety mode holds."""


def _no_server(address: str, port: int) -> Socket | None:
    """No network is emulated."""
    return None


class Console:
    """Messages of programs, the newest, and the network that they see."""

    def __init__(self) -> None:
        self.sayings: deque[Saying] = deque(maxlen=MESSAGES_MAX)
        self.listeners: list[Listener] = []
        self.popup_open = False
        """A pop-up stands on the pendant."""
        self.open_socket: Callable[[str, int], Socket | None] = _no_server
        """Opens a connection to an address and a port. Set by the one that serves the controller."""
        self._safety = SafetyMode.NORMAL

    def tell(self, saying: Saying) -> None:
        """Report a message of a program, or about one."""
        self.sayings.append(saying)
        if saying.message in (Message.POPUP, Message.STOPPED):
            self.popup_open = saying.message is Message.POPUP
        for listener in self.listeners:
            listener.hear(saying)

    def report_safety(self, mode: SafetyMode) -> None:
        """Report the safety mode of this cycle to listeners, if it has changed."""
        if mode == self._safety:
            return
        self._safety = mode
        for listener in self.listeners:
            listener.hear_safety(mode)
