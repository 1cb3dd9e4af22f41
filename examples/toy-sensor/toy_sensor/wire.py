"""The load cell on the wire: datagrams of UDP, packed little-endian, and the client that the bridge drives.

| datagram | way | content |
|---|---|---|
| `LH`, `LB` | to the load cell | hello and goodbye: begin and end to send samples, 500 a second |
| `LS` | from the load cell | number, fx fy fz in mN, mx my mz in 0.1 mN·m, bit k for axis k at its end |
"""

import struct
from collections import deque
from collections.abc import Sequence

from protocol.datagram import arrived_at
from protocol.geometry import Wrench
from protocol.wrench import (
    HostTare,
    SensorEvent,
    SensorFacts,
    SensorFailed,
    SensorReady,
    SensorStatistics,
    SensorStopped,
    WrenchFrame,
    Zeroed,
)

SAMPLE = struct.Struct("<2sI6iB")
HELLO, BYE = b"LH", b"LB"
PERIOD_S = 0.002
HELLO_AGAIN_S = 0.25
"""Time without samples after which the client says hello again, s."""
HELLOS = 40
"""Number of hellos after which the client gives up."""
RANGE_COUNTS = 200_000
SCALES: Wrench = (1e-3, 1e-3, 1e-3, 1e-4, 1e-4, 1e-4)
"""N and N·m per count."""
FACTS = SensorFacts(
    model="toy load cell",
    scales=SCALES,
    full_scales=(200.0, 200.0, 200.0, 20.0, 20.0, 20.0),
    range=(200.0, 200.0, 200.0, 20.0, 20.0, 20.0),
    period=PERIOD_S,
    delay=0.0,
    tares="host",
)


class LoadClient:
    """Client of the load cell: it keeps the zero, which the load cell does not have."""

    stop_patience = 0.0

    def __init__(self, now: float) -> None:
        self.statistics = SensorStatistics()
        self._events: deque[SensorEvent] = deque()
        self._out: list[bytes] = []
        self._hellos = HELLOS
        self._hello_at: float | None = now
        self._tare = HostTare(samples=50)
        self._counter: int | None = None

    def receive(self, data: Sequence[bytes], now: float) -> None:
        for datagram in data:
            if len(datagram) != SAMPLE.size or not datagram.startswith(b"LS"):
                self.statistics.malformed += 1
                continue
            _, counter, fx, fy, fz, mx, my, mz, ends = SAMPLE.unpack(datagram)
            if self._counter is None:
                self._events.append(SensorReady(FACTS))
            elif counter <= self._counter:
                self.statistics.repeated += 1
                continue
            else:
                self.statistics.lost += counter - self._counter - 1
            self._counter, self._hello_at = counter, None
            values = self._tare.values((fx, fy, fz, mx, my, mz))
            self._events.append(WrenchFrame(values, counter, counter, arrived_at(datagram, now), ends))
            if self._tare.took:
                self._events.append(Zeroed())

    def next_event(self) -> SensorEvent | None:
        return self._events.popleft() if self._events else None

    def data_to_send(self, now: float) -> Sequence[bytes]:
        out, self._out = self._out, []
        return out

    def next_deadline(self) -> float | None:
        return self._hello_at

    def handle_deadline(self, now: float) -> None:
        if self._hello_at is not None and now >= self._hello_at:
            if not self._hellos:
                self._hello_at = None
                self._events.append(SensorFailed("no sample came", "look at its supply and its address"))
                return
            self._hellos -= 1
            self._out.append(HELLO)
            self._hello_at = now + HELLO_AGAIN_S

    def zero(self) -> None:
        self._tare.zero()

    def stop(self) -> None:
        self._hello_at = None
        self._out.append(BYE)
        self._events.append(SensorStopped())
