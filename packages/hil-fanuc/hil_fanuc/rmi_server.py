"""Remote Motion Interface of the emulated controller: the first door, and the session of one client behind it.

The door answers every client with the port of the session. A second client can connect there and is never answered
(observed). After FRC_Disconnect another client has to wait longer than after a connection that was lost.
"""

import math
from collections import deque

from emulators.orders import Act, ReceivedOrder
from hil_fanuc import rmi
from hil_fanuc.rmi import LineReader, Message
from hil_fanuc.rmi_commands import Commands
from hil_fanuc.rmi_interface import Interface
from protocol.endpoint import RemoteProtocolError

MAJOR, MINOR = 9, 0
"""Version of the interface. Observed."""
CONNECTS = "FRC_Connect", rmi.CONNECT
"""Names of the request at the door."""
_LINES_MAX = 64
"""Largest number of lines that wait for their answers. Chosen."""


class Door:
    """Endpoint of a connection to the first door."""

    closing = False

    def __init__(self, interface: Interface) -> None:
        self._interface, self._reader = interface, LineReader()
        self._out = bytearray()

    def receive(self, data: bytes, now: float) -> None:
        for message in _messages(self._reader, data):
            name = rmi.name_of(message)
            answer: Message = {name.key: name.name} if name.key else {}
            if name.name in CONNECTS:
                self._interface.host.report_order(ReceivedOrder(now, Act.CONTACT, name.name, True))
                facts = {"PortNumber": self._interface.port, "MajorVersion": MAJOR, "MinorVersion": MINOR}
                answer |= {"ErrorID": 0, **facts}
            else:
                answer["ErrorID"] = rmi.BAD_COMMAND
            if not self._interface.host.is_silent(now):
                self._out += rmi.encode(answer)

    def next_event(self) -> None:
        return None

    def data_to_send(self, now: float) -> bytes:
        out, self._out = bytes(self._out), bytearray()
        return out

    def next_deadline(self) -> float | None:
        return None

    def handle_deadline(self, now: float) -> None:
        """Do nothing: the door answers at once."""

    def close(self, now: float) -> None:
        """Do nothing: a connection to the door has no state."""


class Connection:
    """Endpoint of a connection to the port of the session."""

    def __init__(self, interface: Interface, now: float) -> None:
        self._interface, self._reader = interface, LineReader()
        self._waiting: deque[tuple[float, Message]] = deque(maxlen=_LINES_MAX)
        """Lines with the times of their answers, s."""
        self._out = bytearray()
        self.closing = False
        self._received_at = now
        self._is_disconnected = False
        interface.claim(self, now)

    def receive(self, data: bytes, now: float) -> None:
        if not self._interface.claim(self, now):
            return
        self._received_at = now
        delay = self._interface.host.profile.rmi_answer_ms / 1e3
        for message in _messages(self._reader, data):
            begin = max(now, self._waiting[-1][0] if self._waiting else now)
            self._waiting.append((begin + delay, message))

    def next_event(self) -> None:
        return None

    def data_to_send(self, now: float) -> bytes:
        out, self._out = bytes(self._out), bytearray()
        return out

    def next_deadline(self) -> float | None:
        idle = self._interface.host.profile.rmi_idle_min * 60.0
        ends = self._received_at + idle if idle and self._interface.owner is self else math.inf
        at = min(self._waiting[0][0] if self._waiting else math.inf, ends)
        return None if at == math.inf else at

    def handle_deadline(self, now: float) -> None:
        while self._waiting and self._waiting[0][0] <= now:
            _, message = self._waiting.popleft()
            self._handle(message, now)
        idle = self._interface.host.profile.rmi_idle_min * 60.0
        if idle and self._interface.owner is self and now >= self._received_at + idle:
            self.push({"Communication": "FRC_Terminate"})
            self._end(now, by_request=True)

    def close(self, now: float) -> None:
        if not self._is_disconnected:
            self._interface.free(self, now, by_request=False)

    def push(self, message: Message) -> None:
        """Send a line that answers no request."""
        self._out += rmi.encode(message)

    def _end(self, now: float, by_request: bool) -> None:
        self.closing = self._is_disconnected = True
        self._interface.free(self, now, by_request)

    def _handle(self, message: Message, now: float) -> None:
        host = self._interface.host
        if host.is_silent(now):
            return
        name = rmi.name_of(message)
        if name.name == "FRC_Disconnect":
            self.push({name.key: name.name, "ErrorID": 0})
            self._end(now, by_request=True)
            return
        answer = Commands(self._interface, now).answer(name.name, message)
        if answer is not None:
            self.push({**({name.key: name.name} if name.key else {}), **answer})


def _messages(reader: LineReader, data: bytes) -> list[Message]:
    """Return the messages in received data. A line that cannot be read becomes a message without a name."""
    messages: list[Message] = []
    pending = data
    while True:
        try:
            messages.extend(reader.feed(pending))
        except RemoteProtocolError:
            messages.append({})
            pending = b""
            continue
        return messages
