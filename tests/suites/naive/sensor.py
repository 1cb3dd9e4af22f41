"""Client of the Robotiq FT 300 stream, in eighty lines. The sensor streams from power-up."""

import struct
from collections import deque
from dataclasses import dataclass
from typing import Any

from emulators.devices.ft300 import FT300_FAULTS, Ft300, Ft300Profile
from hil_bridge.devices.kinds import KindSettings, SensorEmulation, SensorKind
from protocol.wrench import (
    SensorEvent,
    SensorFacts,
    SensorReady,
    SensorStatistics,
    SensorStopped,
    WrenchFrame,
    Zeroed,
)

MISTAKES = ("moment-sign", "zero-unit", "check", "split", "repeat", "overload")
SCALES = (0.01, 0.01, 0.01, 0.001, 0.001, 0.001)
RATED = (300.0, 300.0, 300.0, 30.0, 30.0, 30.0)
FACTS = SensorFacts("naive FT 300", SCALES, RATED, RATED, 0.01, 0.0, "host")
SIZE = 16


@dataclass(frozen=True)
class NaiveSettings:
    mistake: str = ""


def crc16(data: bytes) -> int:
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return crc


class NaiveSensorClient:
    stop_patience = 0.0

    def __init__(self, mistake: str) -> None:
        self.statistics = SensorStatistics()
        self._mistake = mistake
        self._events: deque[SensorEvent] = deque()
        self._kept = b""
        self._count = 0
        self._zero: tuple[float, ...] = (0.0,) * 6
        self._taking = False
        self._last: Any = None
        self._repeat_at: float | None = None

    def receive(self, data: bytes, now: float) -> None:
        if self._mistake == "split" and not data.startswith(b"\x20\x4e"):
            self._kept = b"" if len(data) > 2 else self._kept + data  # a fragment is treated as noise
        else:
            self._kept += data
        while len(self._kept) >= SIZE:
            message = self._kept[:SIZE]
            is_valid = int.from_bytes(message[14:], "little") == crc16(message[:14])
            if message.startswith(b"\x20\x4e") and (is_valid or self._mistake == "check"):
                self._publish(struct.unpack("<6h", message[2:14]), now)
                self._kept = self._kept[SIZE:]
            else:
                self.statistics.malformed += 1
                self._kept = self._kept[1:]

    def _publish(self, counts: tuple[int, ...], now: float) -> None:
        if not self._count:
            self._events.append(SensorReady(FACTS))
        self._count += 1
        if self._mistake == "moment-sign":
            counts = (*counts[:4], -counts[4], counts[5])
        ends = zip(counts, RATED, SCALES, strict=True)
        saturated = sum(1 << k for k, (count, end, scale) in enumerate(ends) if abs(count) * scale >= end)
        if self._mistake == "overload":
            saturated = 0
        values: Any = tuple(count - zero for count, zero in zip(counts, self._zero, strict=True))
        self._last = WrenchFrame(values, self._count, self._count, now, saturated)
        self._events.append(self._last)
        if self._taking:
            self._taking = False
            unit = SCALES if self._mistake == "zero-unit" else (1.0,) * 6
            self._zero = tuple(count * one for count, one in zip(counts, unit, strict=True))
            self._events.append(Zeroed())
        if self._mistake == "repeat":
            self._repeat_at = now + 0.02

    def next_event(self) -> SensorEvent | None:
        return self._events.popleft() if self._events else None

    def data_to_send(self, now: float) -> bytes:
        return b""

    def next_deadline(self) -> float | None:
        return self._repeat_at

    def handle_deadline(self, now: float) -> None:
        """Planted mistake: since the control requires a frame every 20 ms, invent one."""
        if self._repeat_at is not None and now >= self._repeat_at:
            self._repeat_at = now + 0.02
            self._count += 1
            self._last = self._last._replace(counter=self._count, sequence=self._count, at=now)
            self._events.append(self._last)

    def zero(self) -> None:
        self._taking = True

    def stop(self) -> None:
        """Leave the sensor streaming for the next client."""
        self._repeat_at = None
        self._events.append(SensorStopped())


async def connect(url: str, settings: KindSettings[NaiveSettings, Ft300Profile], wiring: Any) -> Any:
    return await wiring.bytes(url), NaiveSensorClient(settings.client.mistake)


async def serve(
    url: str, sensor: Any, settings: KindSettings[NaiveSettings, Ft300Profile], serving: Any
) -> str:
    address: str = await serving.serve_bytes(url, sensor.endpoint)
    return address


EMULATION = SensorEmulation(
    Ft300Profile,
    lambda settings: lambda source, now, seed: Ft300(settings.emulated, source, now, seed),
    serve,
    lambda settings, virtual: "memory:naive",
    FT300_FAULTS,
)
SENSOR = SensorKind("naive-sensor", "FT 300 by another client", NaiveSettings, connect, EMULATION)


def settings(mistake: str = "") -> KindSettings[NaiveSettings, Ft300Profile]:
    return KindSettings(NaiveSettings(mistake), Ft300Profile(power_up="stream"))
