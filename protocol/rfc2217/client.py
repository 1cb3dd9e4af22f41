"""Client side of a serial port over TCP.

Reference: RFC 2217. The port is ready when the server has confirmed all requested settings.
"""

from dataclasses import dataclass
from enum import Enum, auto
from typing import TypeAlias

from protocol.endpoint import LocalProtocolError
from protocol.rfc2217.com_port import (
    ERRORS,
    Command,
    Control,
    LineState,
    PortSettings,
)
from protocol.rfc2217.session import (
    OPTIONS,
    LineStateChanged,
    Malformed,
    SerialData,
    Session,
)
from protocol.rfc2217.telnet import Negotiation, Option, Options, Verb

PATIENCE_S = 4.0
"""Time limit for a server to confirm the settings, s. Chosen: shorter than the time-out for opening a connection."""


@dataclass(frozen=True, slots=True)
class PortReady:
    """The port is configured as requested; payload may be sent."""


@dataclass(frozen=True, slots=True)
class PortFailed:
    """The port cannot be used, or can no longer be used. The text gives the reason and the remedy."""

    text: str


ClientEvent: TypeAlias = PortReady | PortFailed | SerialData | LineStateChanged | Malformed


class _State(Enum):
    OFFERED = auto()
    """The COM port option was offered to the server."""
    SETTING = auto()
    READY = auto()
    FAILED = auto()


class ComPortClient:
    """Endpoint that negotiates the option, configures the port, and then carries payload."""

    def __init__(self, settings: PortSettings, now: float, patience_s: float = PATIENCE_S) -> None:
        self._settings = settings
        self._requested = {
            Command.SET_BAUDRATE: settings.baudrate,
            Command.SET_DATASIZE: settings.data_size,
            Command.SET_PARITY: int(settings.parity),
            Command.SET_STOPSIZE: int(settings.stop_size),
        }
        self._confirmed: set[Command] = set()
        self._state = _State.OFFERED
        self._deadline = now + patience_s
        options = (*OPTIONS, Option.COM_PORT)
        self._session: Session[ClientEvent] = Session(Options(options, options), server=False)
        self._session.say(self._session.options.ask())

    def receive(self, data: bytes, now: float) -> None:
        """Process received bytes."""
        for event in self._session.receive(data):
            if isinstance(event, Negotiation):
                self._on_negotiation(event)
            else:
                self._on_command(*event)

    def next_event(self) -> ClientEvent | None:
        """Return the oldest event not yet taken, or None."""
        events = self._session.events
        return events.popleft() if events else None

    def data_to_send(self, now: float) -> bytes:
        """Return everything that may be sent now."""
        return self._session.data_to_send()

    def next_deadline(self) -> float | None:
        """Return the time at which the server must have confirmed the settings, s."""
        return self._deadline if self._state in (_State.OFFERED, _State.SETTING) else None

    def handle_deadline(self, now: float) -> None:
        """Report a failure if the server has not confirmed the settings in time."""
        deadline = self.next_deadline()
        if deadline is None or now < deadline:
            return
        if self._state is _State.OFFERED:
            self._fail("the server does not respond in Telnet; use tcp:// for a raw port")
        else:
            missing = ", ".join(command.name for command in self._requested if command not in self._confirmed)
            self._fail(f"the server does not confirm {missing}; check its settings for this port")

    def send(self, data: bytes) -> None:
        """Queue payload for the port. Raises LocalProtocolError if the port is not ready yet or the queue is full."""
        if self._state is not _State.READY:
            raise LocalProtocolError("the port is not ready")
        self._session.send(data)

    def set_break(self, on: bool) -> None:
        """Begin or end a break on the port. Raises LocalProtocolError if the port is not ready yet."""
        if self._state is not _State.READY:
            raise LocalProtocolError("the port is not ready")
        self._session.command(Command.SET_CONTROL, Control.BREAK_ON if on else Control.BREAK_OFF)

    def _fail(self, text: str) -> None:
        if self._state is not _State.FAILED:
            self._state = _State.FAILED
            self._session.events.append(PortFailed(text))

    def _on_negotiation(self, event: Negotiation) -> None:
        if event.option != Option.COM_PORT:
            return
        if event.verb is Verb.DONT:
            self._fail("the server does not support com port control; use tcp:// for a raw port")
        elif self._state is _State.OFFERED and self._session.options.used_here(Option.COM_PORT):
            self._state = _State.SETTING
            for command, value in self._requested.items():
                self._session.command(command, value)
            self._session.command(Command.SET_CONTROL, Control.NO_FLOW)
            self._session.command(Command.SET_LINESTATE_MASK, ERRORS)

    def _on_command(self, command: Command, value: int) -> None:
        if command is Command.NOTIFY_LINESTATE and value & ERRORS:
            self._session.events.append(LineStateChanged(LineState(value) & ERRORS))
        if command not in self._requested or self._state not in (_State.SETTING, _State.READY):
            return
        if value != self._requested[command]:
            self._fail(
                f"the server answers {command.name} with {value}, not {self._requested[command]}; "
                f"allow {self._settings} on its port"
            )
            return
        self._confirmed.add(command)
        if self._state is _State.SETTING and len(self._confirmed) == len(self._requested):
            self._state = _State.READY
            self._session.events.append(PortReady())
