"""The sensor's protocol: unsolicited messages on a line of 115200 baud, and the client that the bridge drives.

| bytes | content |
|---|---|
| 0, 1 | `A5 5A` |
| 2 | counter, 0 to 255 and again 0 |
| 3 to 14 | fx fy fz in 0.1 N, mx my mz in 0.01 N·m, each two bytes, low byte first |
| 15, 16 | check sum of all before, CRC-16/CCITT from FFFF on, low byte first |
"""

import struct
from binascii import crc_hqx
from collections.abc import Sequence
from typing import NamedTuple

from protocol.geometry import Wrench
from protocol.sensor_events import SensorEventQueue
from protocol.wrench import SensorFacts, SensorStatistics

BAUDRATE = 115_200
HEADER = b"\xa5\x5a"
BODY = struct.Struct("<2sB6h")
SIZE = BODY.size + 2
PERIOD_S = 0.004
COUNTERS = 256
"""Number of counter values. It repeats after 1.024 s, which is longer than a run tolerates a silent sensor."""
SILENCE_S = 2.0
"""Time without a message after which the client gives up, s."""
END_COUNTS = 5000
"""Counts of an axis at the end of its range."""
SCALES: Wrench = (0.1, 0.1, 0.1, 0.01, 0.01, 0.01)
"""N and N·m per count."""
ENDS: Wrench = (500.0, 500.0, 500.0, 50.0, 50.0, 50.0)
FACTS = SensorFacts("toy sensor on a line", SCALES, ENDS, ENDS, PERIOD_S, 0.0, "host")


class Message(NamedTuple):
    """Decoded message."""

    counter: int
    counts: tuple[int, ...]
    """Counts of fx fy fz mx my mz."""


def encode(message: Message) -> bytes:
    """Return the bytes of a message. Raises struct.error for counts that do not fit."""
    body = BODY.pack(HEADER, message.counter % COUNTERS, *message.counts)
    return body + crc_hqx(body, 0xFFFF).to_bytes(2, "little")


class Reader:
    """Decoder of messages from arbitrarily fragmented bytes. Data may contain the header, so the check sum decides."""

    def __init__(self) -> None:
        self._waiting = b""
        self.noises = 0
        """Number of contiguous byte sequences that belong to no message."""
        self._in_noise = False

    def feed(self, data: bytes) -> list[Message]:
        """Process received bytes and return the complete messages. Less than one message is kept."""
        waiting, at, messages = self._waiting + data, 0, []
        while len(waiting) - at >= SIZE:
            body, check = waiting[at : at + BODY.size], waiting[at + BODY.size : at + SIZE]
            if body.startswith(HEADER) and crc_hqx(body, 0xFFFF) == int.from_bytes(check, "little"):
                _, counter, *counts = BODY.unpack(body)
                messages.append(Message(counter, tuple(counts)))
                self._in_noise = False
                at += SIZE
                continue
            self.noises += not self._in_noise
            self._in_noise = True
            following = waiting.find(HEADER[:1], at + 1)
            at = len(waiting) if following < 0 else following
        self._waiting = waiting[at:]
        return messages


def saturated_axes(counts: Sequence[int]) -> int:
    """Return a bit mask with bit k set for axis k at the end of its range."""
    return sum(1 << axis for axis, count in enumerate(counts) if abs(count) >= END_COUNTS)


class LineClient:
    """Client of the sensor: it sends nothing, and keeps the zero, which the sensor does not have."""

    stop_patience = 0.0

    def __init__(self, now: float) -> None:
        self.statistics = SensorStatistics()
        self._reader = Reader()
        self._sensor_events = SensorEventQueue(zero_samples=25)
        self.next_event, self.zero, self.stop = (
            self._sensor_events.next_event,
            self._sensor_events.zero,
            self._sensor_events.stop,
        )
        self._counter: int | None = None
        self._sequence = 0
        self._due = now + SILENCE_S

    def receive(self, data: bytes, now: float) -> None:
        """Process received bytes."""
        if self._sensor_events.ended:
            return
        before = self._reader.noises
        messages = self._reader.feed(data)
        self.statistics.malformed += self._reader.noises - before
        for message in messages:
            self._due = now + SILENCE_S
            if self._is_new(message.counter):
                counts, ends = message.counts, saturated_axes(message.counts)
                self._sensor_events.numbered_sample(counts, message.counter, self._sequence, now, ends)

    def _is_new(self, counter: int) -> bool:
        """Unwrap the counter, and return whether this message is newer than the newest one."""
        if self._counter is None:
            self._sensor_events.begin(FACTS)
            self._counter = counter
            return True
        step = (counter - self._counter) % COUNTERS
        self.statistics.standing = self.statistics.standing + 1 if step == 0 else 0
        if step == 0 or step > COUNTERS // 2:  # the same one, or one from before
            self.statistics.repeated += 1
            return False
        self.statistics.lost += step - 1
        self._counter, self._sequence = counter, self._sequence + step
        return True

    def data_to_send(self, now: float) -> bytes:
        """Return no bytes: the client sends nothing."""
        return b""

    def handle_deadline(self, now: float) -> None:
        """Give up if the sensor has been silent too long."""
        if not self._sensor_events.ended and now >= self._due:
            advice = f"check its supply, its cable and the line: {BAUDRATE} baud, 8 data bits, no parity"
            self._sensor_events.fail(f"no message received for {SILENCE_S:g} s", advice)

    def next_deadline(self) -> float | None:
        """Return when the silence becomes too long, s."""
        return None if self._sensor_events.ended else self._due
