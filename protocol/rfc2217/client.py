"""The computer's side of a serial port behind a TCP connection.

Reference: RFC 2217. The port is ready when the server has confirmed every setting that was asked for.
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
"""Longest time that a server may take to confirm, s. Chosen: less than what opening a connection may take."""


@dataclass(frozen=True, slots=True)
class PortReady:
    """The port is set as was asked; payload may be sent."""


@dataclass(frozen=True, slots=True)
class PortFailed:
    """The port cannot be used, or not any more; says why and what to do."""

    text: str


ClientEvent: TypeAlias = PortReady | PortFailed | SerialData | LineStateChanged | Malformed


class _State(Enum):
    OFFERED = auto()
    """The option was offered to the server."""
    SETTING = auto()
    READY = auto()
    FAILED = auto()


class ComPortClient:
    """Endpoint that offers the option, sets the port, and then carries payload."""

    def __init__(self, settings: PortSettings, now: float, patience_s: float = PATIENCE_S) -> None:
        self._settings = settings
        self._asked = {
            Command.SET_BAUDRATE: settings.baudrate,
            Command.SET_DATASIZE: settings.data_size,
            Command.SET_PARITY: int(settings.parity),
            Command.SET_STOPSIZE: int(settings.stop_size),
        }
        self._confirmed: set[Command] = set()
        self._state = _State.OFFERED
        self._deadline = now + patience_s
        wanted = (*OPTIONS, Option.COM_PORT)
        self._session: Session[ClientEvent] = Session(Options(wanted, wanted), server=False)
        self._session.say(self._session.options.ask())

    def receive(self, data: bytes, now: float) -> None:
        """Take what arrived."""
        for said in self._session.receive(data):
            if isinstance(said, Negotiation):
                self._negotiated(said)
            else:
                self._commanded(*said)

    def next_event(self) -> ClientEvent | None:
        """Return the oldest event not yet taken."""
        events = self._session.events
        return events.popleft() if events else None

    def data_to_send(self, now: float) -> bytes:
        """Everything that may be sent now."""
        return self._session.data_to_send()

    def next_deadline(self) -> float | None:
        """When the server's time to confirm is over."""
        return self._deadline if self._state in (_State.OFFERED, _State.SETTING) else None

    def handle_deadline(self, now: float) -> None:
        """Fail when the server has not confirmed by then."""
        deadline = self.next_deadline()
        if deadline is None or now < deadline:
            return
        if self._state is _State.OFFERED:
            self._fail("the server does not answer in Telnet; a raw port is reached as tcp://")
        else:
            missing = ", ".join(command.name for command in self._asked if command not in self._confirmed)
            self._fail(f"the server does not confirm {missing}; look at its own settings for this port")

    def send(self, data: bytes) -> None:
        """Payload for the port. Raises LocalProtocolError before the port is ready and when too much waits."""
        if self._state is not _State.READY:
            raise LocalProtocolError("the port is not ready")
        self._session.send(data)

    def set_break(self, on: bool) -> None:
        """Hold the port's line low, or no longer. Raises LocalProtocolError before the port is ready."""
        if self._state is not _State.READY:
            raise LocalProtocolError("the port is not ready")
        self._session.command(Command.SET_CONTROL, Control.BREAK_ON if on else Control.BREAK_OFF)

    def _fail(self, text: str) -> None:
        if self._state is not _State.FAILED:
            self._state = _State.FAILED
            self._session.events.append(PortFailed(text))

    def _negotiated(self, said: Negotiation) -> None:
        if said.option != Option.COM_PORT:
            return
        if said.verb is Verb.DONT:
            self._fail("the server has no com port control; a raw port is reached as tcp://")
        elif self._state is _State.OFFERED and self._session.options.used_here(Option.COM_PORT):
            self._state = _State.SETTING
            for command, value in self._asked.items():
                self._session.command(command, value)
            self._session.command(Command.SET_CONTROL, Control.NO_FLOW)
            self._session.command(Command.SET_LINESTATE_MASK, ERRORS)

    def _commanded(self, command: Command, value: int) -> None:
        if command is Command.NOTIFY_LINESTATE and value & ERRORS:
            self._session.events.append(LineStateChanged(LineState(value) & ERRORS))
        if command not in self._asked or self._state not in (_State.SETTING, _State.READY):
            return
        if value != self._asked[command]:
            self._fail(
                f"the server answers {command.name} with {value}, not {self._asked[command]}; "
                f"allow {self._settings} on its port"
            )
            return
        self._confirmed.add(command)
        if self._state is _State.SETTING and len(self._confirmed) == len(self._asked):
            self._state = _State.READY
            self._session.events.append(PortReady())
