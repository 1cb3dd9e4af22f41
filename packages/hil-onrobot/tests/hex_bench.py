"""Emulated sensor without a wire, for the tests."""

from typing import Any

from hil_onrobot.faults import HEX_FAULTS
from hil_onrobot.messages import RECORD, Command, encode_request
from hil_onrobot.profile import HexProfile
from hil_onrobot.sensor import HexSensor

from emulators.faults import Ledger
from emulators.sensing import SteppedWrench
from protocol.datagram import Datagram
from protocol.geometry import Wrench

EPOCH = 1000.0005
"""Time of power-up, s: between two samples."""
QUIET = {
    "noise_n": 0.0,
    "noise_nm": 0.0,
    "wander_n": 0.0,
    "creep_share": 0.0,
    "vibration_n": 0.0,
    "motion_n": 0.0,
    "hysteresis_share": 0.0,
    "cross_talk_share": 0.0,
    "latency_s": 0.0,
    "filter": 0,
    "every": 1,
}
"""Settings of a sensor without errors, filter and delays."""
HERE, ELSEWHERE = ("192.0.2.7", 1), ("192.0.2.8", 1)
LOAD: Wrench = (10.0, -20.0, 30.0, 1.0, -2.0, 3.0)
COUNTS = (100_000, -200_000, 300_000, 100_000, -200_000, 300_000)


class Bench:
    """Sensor with a load, and time."""

    def __init__(self, **settings: Any) -> None:
        self.now = EPOCH
        self.source = SteppedWrench(LOAD)
        self.sensor = HexSensor(HexProfile(**QUIET | settings), self.source, EPOCH, 1)
        self.ledger = Ledger(HEX_FAULTS)
        for target, handlers in self.sensor.handlers.items():
            self.ledger.attach(target, handlers)

    def push(self, load: Wrench) -> None:
        self.source.step(load, self.now)

    def send(self, command: Command, value: int = 0, side: Any = HERE) -> None:
        self.send_bytes(encode_request(command, value), side)

    def send_bytes(self, data: bytes, side: Any = HERE) -> None:
        self.sensor.endpoint.receive([Datagram(data, self.now, side)], self.now)

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

    def records(self, seconds: float) -> list[tuple[int, ...]]:
        """Return sequence, sample, status and counts of the records of a time."""
        return [RECORD.struct.unpack(one) for one in self.datagrams(seconds)]

    def inject(self, on: str, fault: str, **values: Any) -> None:
        self.ledger.inject(on, fault, self.now, values)
