"""Emulated FT 300 behind Robotiq's URCap: texts of its newest message, while the URCap has detected a sensor.

The URCap's loop does not wait for a message. It sends the newest one, and repeats it if no other has arrived. The
URCap has its own zero, which a robot program sets over another port. It is not emulated: the zero is 0 after the
start.
"""

import random
from collections import deque
from collections.abc import Mapping

import numpy as np

from emulators.devices.ft300.faults import TEXTS
from emulators.devices.ft300.profile import Ft300Profile
from emulators.devices.ft300.sensor import measured_counts
from emulators.faults.ledger import Handler
from emulators.faults.own import OwnFaults
from emulators.faults.packets import SENSOR_WIRE, Packets
from emulators.seams import WrenchSource
from emulators.unmodelled import Unmodelled
from protocol.devices.ft300.messages import BAUDRATE, MESSAGE_SIZE, PERIOD_S
from protocol.devices.ft300.urcap import encode_text

_LINE_S = 10 * MESSAGE_SIZE / BAUDRATE
"""Duration of a message on the sensor's line, s. Derived."""
_DIVISORS = np.array((100,) * 3 + (1000,) * 3, dtype=np.float32)
"""Counts per N and per N·m, in the precision of the maker's server."""
_REMEMBERED = 4096
"""Number of texts whose time is stored. Chosen."""


class UrcapServer:
    """Sensor and URCap as a client sees them: texts are sent, and received bytes are ignored. An `EmulatedSensor`."""

    def __init__(self, profile: Ft300Profile, source: WrenchSource, powered_at: float, seed: int) -> None:
        self.profile = profile
        self._measured = measured_counts(profile, source, powered_at, seed)
        self.endpoint: Packets[bytes] = Packets(self, TEXTS, f"{seed} texts")
        """URCap's end of the wire."""
        self.unmodelled = Unmodelled("ft300")
        self._seed = seed
        self._faults = faults = OwnFaults()
        self._sample_times: deque[tuple[int, float]] = deque(maxlen=_REMEMBERED)
        """Numbers of a client's texts, each with the time of its measurement, s."""
        self._count = 0
        self._repeated = profile.urcap_repeats
        """Loop iterations since the newest message. The initial value is so large that nothing is sent before the
        first message.
        """
        self._out = bytearray()
        self._alive_from = powered_at + profile.boot_s
        """Time at which the sensor's stream begins, s. Until then the URCap searches for the sensor."""
        self._sample = self._measured.number_at(powered_at) - 1
        """Number of the last sample received by the URCap."""
        self._next = int(self._alive_from / profile.urcap_period_s) + 1
        """Number of the URCap's next loop iteration."""
        self.handlers: Mapping[str, Mapping[str, Handler]] = {
            "signal": self._measured.signal.handlers,
            SENSOR_WIRE: self.endpoint.handlers,
            "sensor": {
                **faults.ended_by("unplugged", self._boot),
                **faults.held(("slow",)),
                **faults.striking({"power-cycle": self._boot}),
            },
        }

    def sampled_at(self, counter: int) -> float | None:
        """Return the time at which the sample in a client's text with this number was measured, s."""
        return next((at for number, at in reversed(self._sample_times) if number == counter), None)

    def begin(self) -> None:
        """Begin to serve a client. Its texts are counted from 1."""
        self._count = 0
        self._sample_times.clear()

    def _boot(self, now: float) -> None:
        """Restart the sensor. No message arrives until the URCap has detected the loss and detected the sensor
        again.
        """
        lost_at = now + max(0, self.profile.urcap_repeats - self._repeated) * self.profile.urcap_period_s
        self._alive_from = max(now + self.profile.boot_s, lost_at) + self.profile.urcap_search_s

    # --- endpoint

    def receive(self, data: bytes, now: float) -> None:
        """Ignore received bytes: the URCap reads nothing on this port."""

    def next_event(self) -> None:
        """Return None: there are no events."""

    def data_to_send(self, now: float) -> bytes:
        """Return texts that are due."""
        out = bytes(self._out)
        self._out.clear()
        return out

    def next_deadline(self) -> float:
        """Return the time of the URCap's next loop iteration, s."""
        return self._due(self._next)

    def handle_deadline(self, now: float) -> None:
        """Send all texts that are due."""
        while (due := self._due(self._next)) <= now:
            self._next += 1
            self._turn(due)

    def _due(self, number: int) -> float:
        late = random.Random(f"{self._seed} {number}").random() * self.profile.jitter_s
        return number * self.profile.urcap_period_s + late

    def _turn(self, now: float) -> None:
        """Send the newest message, or repeat the previous one if no newer one has arrived. Send nothing once it has
        been repeated too often.
        """
        newest = self._newest(now)
        fresh = newest > self._sample
        self._sample = max(newest, self._sample)
        self._repeated = 0 if fresh else self._repeated + 1
        if self._repeated > self.profile.urcap_repeats:
            return
        self._count += 1
        self._sample_times.append((self._count, self._sample * PERIOD_S))
        counts = self._measured.outputs(self._sample, self._sample)[0]
        self._out += encode_text((counts.astype(np.float32) / _DIVISORS).tolist())

    def _newest(self, now: float) -> int:
        """Return the number of the newest sample that the URCap has received. A slow sensor sends only every n-th
        sample.
        """
        if now < self._alive_from or self._faults.under_way("unplugged", now):
            return self._sample
        newest = self._measured.number_at(now - self.profile.latency_s - _LINE_S)
        slow = self._faults.under_way("slow", now)
        each = 1 if slow is None else max(1, round(slow.number("factor")))
        return newest - newest % each
