"""An emulated FT 300 behind Robotiq's URCap: texts of its newest message, as long as the URCap has a sensor.

The URCap's loop does not wait for a message: it sends the newest one, again where none has come. Its own zero, which a
program of the robot takes over another port, is not emulated: it is none after the start.
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
"""Derived: time of a message on the sensor's line."""
_DIVISORS = np.array((100,) * 3 + (1000,) * 3, dtype=np.float32)
"""Counts for one N and N·m, in the precision of the maker's server."""
_REMEMBERED = 4096
"""Chosen: texts of which the time is known."""


class UrcapServer:
    """Sensor and URCap as a client knows them: texts go out, and nothing is heard. An `EmulatedSensor`."""

    def __init__(self, profile: Ft300Profile, source: WrenchSource, powered_at: float, seed: int) -> None:
        self.profile = profile
        self._measured = measured_counts(profile, source, powered_at, seed)
        self.endpoint: Packets[bytes] = Packets(self, TEXTS, f"{seed} texts")
        """The end of its wire."""
        self.unmodelled = Unmodelled("ft300")
        self._seed = seed
        self._faults = faults = OwnFaults()
        self._told_at: deque[tuple[int, float]] = deque(maxlen=_REMEMBERED)
        """Numbers of the texts of a client, and when each was measured, s."""
        self._count = 0
        self._repeated = profile.urcap_repeats
        """Turns since the newest message; so many at the start, that nothing is sent before the first one."""
        self._out = bytearray()
        self._alive_from = powered_at + profile.boot_s
        """When the sensor's stream began, or begins, s: the URCap looked for it before."""
        self._sample = self._measured.number_at(powered_at) - 1
        """Number of the sample that the URCap received last."""
        self._next = int(self._alive_from / profile.urcap_period_s) + 1
        """Number of the URCap's turn that is next."""
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
        """When the sample of the text was measured that is the one of this number for its client, s."""
        return next((at for number, at in reversed(self._told_at) if number == counter), None)

    def begin(self) -> None:
        """Begin to serve a client: its texts count from 1."""
        self._count = 0
        self._told_at.clear()

    def _boot(self, now: float) -> None:
        """Restart the sensor: no message comes until the URCap has detected the loss and found it again."""
        given_up = now + max(0, self.profile.urcap_repeats - self._repeated) * self.profile.urcap_period_s
        self._alive_from = max(now + self.profile.boot_s, given_up) + self.profile.urcap_search_s

    # --- endpoint

    def receive(self, data: bytes, now: float) -> None:
        """Ignore what arrives: the URCap reads nothing on this port."""

    def next_event(self) -> None:
        """Return None: there are no events."""

    def data_to_send(self, now: float) -> bytes:
        """Texts whose time has come."""
        out = bytes(self._out)
        self._out.clear()
        return out

    def next_deadline(self) -> float:
        """When the URCap's next turn is, s."""
        return self._due(self._next)

    def handle_deadline(self, now: float) -> None:
        """Send what is due."""
        while (due := self._due(self._next)) <= now:
            self._next += 1
            self._turn(due)

    def _due(self, number: int) -> float:
        late = random.Random(f"{self._seed} {number}").random() * self.profile.jitter_s
        return number * self.profile.urcap_period_s + late

    def _turn(self, now: float) -> None:
        """Send the newest message, or the one before; nothing when there has been none for too long."""
        newest = self._newest(now)
        fresh = newest > self._sample
        self._sample = max(newest, self._sample)
        self._repeated = 0 if fresh else self._repeated + 1
        if self._repeated > self.profile.urcap_repeats:
            return
        self._count += 1
        self._told_at.append((self._count, self._sample * PERIOD_S))
        counts = self._measured.outputs(self._sample, self._sample)[0]
        self._out += encode_text((counts.astype(np.float32) / _DIVISORS).tolist())

    def _newest(self, now: float) -> int:
        """Return the number of the newest sample whose message the URCap has received, or of the one before."""
        if now < self._alive_from or self._faults.under_way("unplugged", now):
            return self._sample
        newest = self._measured.number_at(now - self.profile.latency_s - _LINE_S)
        slow = self._faults.under_way("slow", now)
        each = 1 if slow is None else max(1, round(slow.number("factor")))
        return newest - newest % each
