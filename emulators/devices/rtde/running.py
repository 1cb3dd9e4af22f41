"""Running programs, their watchdogs, and their messages."""

from collections import deque
from collections.abc import Callable
from typing import NamedTuple, Protocol

from emulators.devices.rtde.urscript import Message, Socket
from emulators.devices.rtde.urscript.limits import MESSAGES_MAX
from protocol.devices.rtde.states import SafetyMode


class Program(Protocol):
    """Program that can be executed."""

    name: str

    def cycle(self) -> bool:
        """Execute one cycle. Return False once the program has ended."""

    def close(self) -> None:
        """Stop the program."""


class Watchdog:
    """Requirement of a program that an input must be updated in time."""

    def __init__(self, name: str, period: float, action: str, now: float) -> None:
        """Start the watchdog. `period` is the longest allowed time between two packages with the input, s; `action`
        is pause or stop.
        """
        self.name, self.period, self.action = name, period, action
        self.last = now
        """Time of the newest package with the input, s."""

    def is_overdue(self, now: float) -> bool:
        """Return whether the input is overdue."""
        return now - self.last > self.period + 1e-9


class ProgramMessage(NamedTuple):
    """Message from a program, or about one."""

    at: float
    """Time of the message, s."""
    message: Message
    text: str
    """Text of the message; for a program that starts or stops, its name."""
    title: str = ""
    """Title, if the message is a pop-up."""
    line: int = 0
    """Line number of an error, starting at 1."""
    column: int = 0

    def __str__(self) -> str:
        place = f", column {self.column}" if self.message is Message.SYNTAX else ""
        return f"{self.message} in line {self.line}{place}: {self.text}" if self.line else self.text


class Listener(Protocol):
    """Receiver of messages as they occur."""

    def hear(self, program_message: ProgramMessage) -> None:
        """Receive a message from a program, or about one."""

    def receive_safety_mode(self, mode: SafetyMode) -> None:
        """Receive a change of the safety mode."""


def _no_server(address: str, port: int) -> Socket | None:
    """Open no connection: there is no emulated network."""
    return None


class Console:
    """Recent messages of programs, and the network available to them."""

    def __init__(self) -> None:
        self.program_messages: deque[ProgramMessage] = deque(maxlen=MESSAGES_MAX)
        self.listeners: list[Listener] = []
        self.popup_open = False
        """Whether the pendant shows a pop-up."""
        self.open_socket: Callable[[str, int], Socket | None] = _no_server
        """Opens a connection to an address and a port. The controller's server sets it."""
        self._safety = SafetyMode.NORMAL

    def tell(self, program_message: ProgramMessage) -> None:
        """Report a message from a program, or about one."""
        self.program_messages.append(program_message)
        if program_message.message in (Message.POPUP, Message.STOPPED):
            self.popup_open = program_message.message is Message.POPUP
        for listener in self.listeners:
            listener.hear(program_message)

    def report_safety(self, mode: SafetyMode) -> None:
        """Report the safety mode of this cycle to listeners, if it has changed."""
        if mode == self._safety:
            return
        self._safety = mode
        for listener in self.listeners:
            listener.receive_safety_mode(mode)
