"""Server side of a serial port over TCP, which owns the port.

Reference: RFC 2217. The server sends no Telnet commands until the client does, so a client that sends none can use
it as a raw port.
"""

from dataclasses import dataclass, replace
from typing import Final, TypeAlias

from protocol.rfc2217.com_port import (
    READY_MODEM,
    Command,
    ComParity,
    Control,
    LineState,
    PortSettings,
    StopSize,
)
from protocol.rfc2217.session import OPTIONS, Malformed, SerialData, Session
from protocol.rfc2217.telnet import Negotiation, Option, Options

SIGNATURE: Final = b"hil-bridge"


@dataclass(frozen=True, slots=True)
class SettingsChanged:
    """The client has changed the settings of the port."""

    settings: PortSettings


@dataclass(frozen=True, slots=True)
class BreakSet:
    """The client has begun or ended a break."""

    on: bool


ServerEvent: TypeAlias = SettingsChanged | BreakSet | SerialData | Malformed

PARITIES = (ComParity.NONE, ComParity.ODD, ComParity.EVEN)
STOP_SIZES = (StopSize.ONE, StopSize.TWO)
"""Supported numbers of stop bits. All baud rates are supported, but only 8 data bits."""

_FLOW = range(Control.ASK_FLOW, Control.ASK_BREAK)
_BREAK = {Control.BREAK_ON: True, Control.BREAK_OFF: False}
_SWITCHES = {
    Control.ASK_DTR: (Control.DTR_ON, Control.DTR_OFF),
    Control.ASK_RTS: (Control.RTS_ON, Control.RTS_OFF),
}


class ComPortServer:
    """Endpoint for one client. It answers a setting that the port does not support with the current setting, as RFC
    2217 requires.
    """

    def __init__(self, settings: PortSettings) -> None:
        self.settings = settings
        """Current settings of the port."""
        self._break = False
        self._switches = dict.fromkeys(_SWITCHES, True)
        """State of DTR and RTS, which are not connected."""
        self._mask = LineState(0)
        self._session: Session[ServerEvent] = Session(
            Options(OPTIONS, (*OPTIONS, Option.COM_PORT)), server=True
        )

    def receive(self, data: bytes, now: float) -> None:
        """Process received bytes."""
        for event in self._session.receive(data):
            if not isinstance(event, Negotiation):
                self._session.command(event[0], self._execute(*event))

    def next_event(self) -> ServerEvent | None:
        """Return the oldest event not yet taken, or None."""
        events = self._session.events
        return events.popleft() if events else None

    def data_to_send(self, now: float) -> bytes:
        """Return everything that may be sent now."""
        return self._session.data_to_send()

    def next_deadline(self) -> float | None:
        """Return None, because a server has no deadline."""
        return None

    def handle_deadline(self, now: float) -> None:
        """Do nothing, because a server has no deadline."""

    def send(self, data: bytes) -> None:
        """Queue bytes that the port has received, for the client. Raises LocalProtocolError if the queue is full."""
        self._session.send(data)

    def notify(self, state: LineState) -> None:
        """Report a damaged character at the port if the client has subscribed to such reports."""
        if state & self._mask:
            self._session.command(Command.NOTIFY_LINESTATE, state & self._mask)

    def _execute(self, command: Command, value: int) -> int | bytes:
        """Execute a command and return the value of its response."""
        match command:
            case Command.SIGNATURE:
                return SIGNATURE
            case Command.SET_BAUDRATE:
                return self._set(replace(self.settings, baudrate=value or self.settings.baudrate)).baudrate
            case Command.SET_DATASIZE:
                return self.settings.data_size
            case Command.SET_PARITY:
                parity = ComParity(value) if value in PARITIES else self.settings.parity
                return self._set(replace(self.settings, parity=parity)).parity
            case Command.SET_STOPSIZE:
                size = StopSize(value) if value in STOP_SIZES else self.settings.stop_size
                return self._set(replace(self.settings, stop_size=size)).stop_size
            case Command.SET_CONTROL:
                return self._set_control(value)
            case Command.SET_LINESTATE_MASK:
                self._mask = LineState(value)
                return value
            case Command.NOTIFY_LINESTATE:
                return 0
            case Command.NOTIFY_MODEMSTATE:
                return READY_MODEM
            case _:  # a mask for signals that do not exist; buffers that are already empty
                return value

    def _set(self, settings: PortSettings) -> PortSettings:
        if settings != self.settings:
            self.settings = settings
            self._session.events.append(SettingsChanged(settings))
        return settings

    def _set_control(self, value: int) -> int:
        if value in _FLOW:
            return Control.NO_FLOW
        if value in _BREAK or value == Control.ASK_BREAK:
            on = _BREAK.get(Control(value), self._break)
            if on is not self._break:
                self._break = on
                self._session.events.append(BreakSet(on))
            return Control.BREAK_ON if on else Control.BREAK_OFF
        for ask, (on_value, off_value) in _SWITCHES.items():
            if value in (ask, on_value, off_value):
                self._switches[ask] = value == on_value if value != ask else self._switches[ask]
                return on_value if self._switches[ask] else off_value
        return Control.NO_INBOUND_FLOW
