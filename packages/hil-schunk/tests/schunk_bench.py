"""Sensor and client without a wire, for the tests."""

from collections.abc import Iterator
from typing import Any

from hil_schunk.client import FtsClient, Port
from hil_schunk.client_settings import FtsClientSettings
from hil_schunk.connection import Connection
from hil_schunk.faults import FTS_FAULTS
from hil_schunk.messages import Command, MessageReader, Packet, decode_packet, encode_command, encode_message
from hil_schunk.profile import FtsProfile
from hil_schunk.sensor import FtsSensor

from emulators.faults import Ledger
from emulators.sensing import SteppedWrench
from protocol.geometry import Wrench
from protocol.pieces import Piece

EPOCH = 1000.0005
"""Time of power-up, s: between two samples."""
QUIET = {
    "noise_n": 0.0,
    "noise_nm": 0.0,
    "wander_n": 0.0,
    "creep_share": 0.0,
    "vibration_n": 0.0,
    "motion_n": 0.0,
    "latency_s": 0.0,
}
"""Settings of a sensor without errors and delays."""
HOST = ("192.0.2.7", 54843)
LOAD: Wrench = (10.0, -20.0, 30.0, 1.0, -2.0, 3.0)


class Bench:
    """Sensor with a load, time, and any number of connections."""

    def __init__(self, load: Wrench = LOAD, **settings: Any) -> None:
        self.now = EPOCH
        self.source = SteppedWrench(load)
        self.sensor = FtsSensor(FtsProfile(**QUIET | settings), self.source, EPOCH, 1)
        self.ledger = Ledger(FTS_FAULTS)
        for target, handlers in self.sensor.handlers.items():
            self.ledger.attach(target, handlers)

    def push(self, load: Wrench) -> None:
        self.source.step(load, self.now)

    def connect(self, side: Any = HOST) -> Connection:
        connection = self.sensor.connect(side, self.now)
        assert connection is not None
        return connection

    def ask(self, connection: Connection, payload: bytes) -> bytes:
        """Return the payload of the answer, or nothing."""
        connection.receive(encode_message(0, payload), self.now)
        messages = MessageReader().feed(connection.data_to_send(self.now))
        return messages[0].payload if messages else b""

    def command(self, connection: Connection, command: Command, value: int | None = None) -> int:
        """Return the error of the answer."""
        return self.ask(connection, encode_command(command, value))[1]

    def datagrams(self, seconds: float) -> list[Any]:
        """Let time pass, and return the datagrams that the sensor sends."""
        ends = self.now + seconds
        sent: list[Any] = []
        while True:
            dues = [due for due in (self.sensor.endpoint.next_deadline(), self.ledger.next_deadline()) if due]
            due = min(dues, default=ends)
            self.now = min(max(self.now, due), ends)
            self.ledger.handle_deadline(self.now)
            self.sensor.endpoint.handle_deadline(self.now)
            sent += self.sensor.endpoint.data_to_send(self.now)
            if due >= ends:
                return sent

    def packets(self, seconds: float) -> list[Packet]:
        return [decode_packet(one) for one in self.datagrams(seconds)]

    def inject(self, on: str, fault: str, **values: Any) -> None:
        self.ledger.inject(on, fault, self.now, values)


class Session:
    """Client whose answers and packets the test gives."""

    def __init__(self, **settings: Any) -> None:
        self.now = EPOCH
        self.client = FtsClient(FtsClientSettings(**settings), EPOCH)
        self._reader = MessageReader()

    def sent(self) -> list[bytes]:
        """Return the payloads of the requests that the client sends now."""
        data = b"".join(piece.data for piece in self.client.data_to_send(self.now))
        return [message.payload for message in self._reader.feed(data)]

    def answer(self, text: str) -> None:
        self.client.receive([Piece(Port.COMMANDS, encode_message(1, bytes.fromhex(text)))], self.now)

    def packet(self, data: bytes) -> None:
        self.client.receive([Piece(Port.DATA, [data])], self.now)

    def events(self) -> Iterator[Any]:
        return iter(self.client.next_event, None)

    def expire(self) -> None:
        """Advance to the next deadline."""
        due = self.client.next_deadline()
        assert due is not None
        self.now = max(due, self.now)
        self.client.handle_deadline(self.now)

    def begin(self) -> None:
        """Answer the start-up."""
        for text in ("f0 00 0100 00 465453", "f0 00 0100 03 313233", "31 00", "40 00"):
            self.sent()
            self.answer(text)
        self.sent()
