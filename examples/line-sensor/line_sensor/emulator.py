"""Emulated sensor: from power-up on it streams, whether a client listens or not."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from emulators.faults import Fault
from emulators.faults.own import OwnFaults
from emulators.faults.packets import BYTES, SENSOR_WIRE, Packets
from emulators.seams import Handlers, WrenchSource
from emulators.sensing import Converter, MeasuredWrench
from emulators.sensing.faults import SIGNAL_FAULTS
from line_sensor.wire import COUNTERS, END_COUNTS, PERIOD_S, SCALES, Message, encode
from protocol.marks import Mark, at_least, check_settings, setting

LINE_FAULTS: Mapping[str, Mapping[str, Fault]] = {
    "signal": SIGNAL_FAULTS,
    SENSOR_WIRE: BYTES.faults,
    "sensor": {
        "unplugged": Fault("its plug is pulled: it sends nothing, and boots when plugged in again", {}, 2.0)
    },
}
"""Faults by target: of every sensor's signal, of every line, and of this sensor."""


@dataclass(frozen=True, slots=True)
class LineProfile:
    """Properties that differ between sensors of this kind."""

    noise_n: float = setting(0.05, Mark.CHOSEN, "noise of the forces, rms", at_least(0.0), unit="N")
    boot_s: float = setting(
        0.1, Mark.CHOSEN, "time from power-up to the first message", at_least(0.0), unit="s"
    )

    def __post_init__(self) -> None:
        check_settings(self)


class LineSensor:
    """Emulated line sensor: an `EmulatedSensor`."""

    def __init__(self, profile: LineProfile, source: WrenchSource, powered_at: float, seed: int) -> None:
        self._profile = profile
        per_unit = 1.0 / np.array(SCALES)
        noise = np.array((*(profile.noise_n,) * 3, *(profile.noise_n / 10.0,) * 3)) * per_unit
        end = np.full(6, float(END_COUNTS))
        converter = Converter(np.diag(per_unit), noise, -end, end)
        rate_hz = round(1.0 / PERIOD_S)
        self._measured = MeasuredWrench(source, rate_hz, converter, seed, "cell.toyline.noise_n")
        self.endpoint: Packets[bytes] = Packets(self, BYTES, f"{seed} messages")
        """Device's end of the line: this sensor behind the faults of the line."""
        self._faults = OwnFaults()
        self.handlers: Handlers = {
            "signal": self._measured.signal.handlers,
            SENSOR_WIRE: self.endpoint.handlers,
            "sensor": self._faults.ended_by("unplugged", self._power_up),
        }
        self._out = bytearray()
        self._power_up(powered_at)

    def _power_up(self, now: float) -> None:
        self._first = self._next = self._measured.first_after(now + self._profile.boot_s)

    def sampled_at(self, counter: int) -> float | None:
        newest = self._next - 1 - self._first
        told = newest - (newest - counter) % COUNTERS
        return (self._first + told) * PERIOD_S if told >= 0 else None

    def receive(self, data: bytes, now: float) -> None:
        """Ignore all data."""

    def next_event(self) -> None:
        return None

    def data_to_send(self, now: float) -> bytes:
        out = bytes(self._out)
        self._out.clear()
        return out

    def next_deadline(self) -> float | None:
        return self._next * PERIOD_S

    def handle_deadline(self, now: float) -> None:
        while self._next * PERIOD_S <= now:
            outputs = self._measured.outputs(self._next, self._next)[0]
            counts = tuple(outputs.astype(np.int64).tolist())
            if self._faults.under_way("unplugged", now) is None:
                self._out += encode(Message(self._next - self._first, counts))
            self._next += 1
