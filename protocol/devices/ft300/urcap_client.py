"""Client of an FT 300 behind Robotiq's URCap. It sends nothing, measures the period of the texts, and reports their
values.

The URCap does not number the texts, so the client counts them. The URCap sleeps 10 ms between texts and then
computes for a while, so its period is not a fixed period of a device clock. The client measures the period before
it reports the first force. The URCap's own zero is set over another port and shared by all its clients. The host
subtracts the zero of a run.
"""

from statistics import linear_regression

from protocol.devices.ft300.messages import PERIOD_S
from protocol.devices.ft300.profile import Ft300ClientProfile
from protocol.devices.ft300.urcap import TextReader
from protocol.geometry import Wrench
from protocol.outbox import Due
from protocol.sensor_events import SensorEventQueue
from protocol.wrench import PERIOD_MAX_S, SensorFacts, SensorStatistics

_COPY_PERIODS = 0.5
"""Time within which a text equal to the previous one is a copy, as a fraction of the period. Chosen: the same value
as for the sensor's own stream. If no new value has arrived, the URCap repeats the previous value, but one period
later.
"""
_LEAST_PERIOD_S = 1e-3
"""Shortest plausible period of the texts, s. Chosen: texts that arrive faster were buffered somewhere; the period
is not measured from them.
"""
_ONE: Wrench = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0)


class UrcapClient(Due):
    """`SensorClient` over a byte stream."""

    def __init__(self, profile: Ft300ClientProfile, now: float) -> None:
        self.statistics = SensorStatistics()
        self.stop_patience = 0.1
        self._profile = profile
        self._rated: Wrench = (*(profile.rated_n,) * 3, *(profile.rated_nm,) * 3)
        self._sensor_events = events = SensorEventQueue(zero_samples=max(1, round(profile.zero_s / PERIOD_S)))
        self.next_event, self.zero = events.next_event, events.zero
        self._patience = profile.tries * profile.answer_timeout_s
        self._due: float | None = now + self._patience
        self._reader = TextReader()
        self._arrivals: list[float] = []
        """Arrival times of the texts from which the period is measured, s."""
        self._count = 0
        self._newest: Wrench | None = None
        """Values of the newest text; `_newest_at` is its arrival time, s."""
        self._newest_at = 0.0

    def receive(self, data: bytes, now: float) -> None:
        """Process received bytes."""
        if self._sensor_events.ended:
            return
        reader, statistics = self._reader, self.statistics
        noises, missed = reader.noises, reader.missed
        texts = reader.feed(data)
        statistics.malformed += reader.noises - noises
        if self._newest is not None:  # a stream that is already running is joined at an arbitrary byte
            statistics.lost += reader.missed - missed
        for values in texts:
            self._process_text(values, now)

    def data_to_send(self, now: float) -> bytes:
        """Return no data, because this client never sends."""
        return b""

    def handle_deadline(self, now: float) -> None:
        """Report the failure of a sensor that has been silent for too long."""
        if self._due is None or now < self._due:
            return
        self._due = None
        if self._newest is None:
            self._sensor_events.fail(
                f"the URCap has sent nothing for {self._patience:g} s",
                "check whether the URCap shows the sensor, and close other clients: it serves one at a time",
            )
        else:
            self._sensor_events.fail(
                f"no text received for {self._profile.silence_s:g} s",
                "check whether the URCap shows the sensor",
            )

    def stop(self) -> None:
        """End the session."""
        if not self._sensor_events.ended:
            self._due = None
            self._sensor_events.stop()

    def _process_text(self, values: Wrench, now: float) -> None:
        self._due = now + self._profile.silence_s
        if values == self._newest and now - self._newest_at < _COPY_PERIODS * PERIOD_S:
            self.statistics.repeated += 1
            return
        self._newest, self._newest_at = values, now
        self._count += 1
        if not self._sensor_events.ready and not self._measure_period(now):
            return
        saturated = 0
        for axis, (value, rated) in enumerate(zip(values, self._rated, strict=True)):
            saturated |= (abs(value) >= rated) << axis
        self._sensor_events.numbered_sample(values, self._count, self._count, now, saturated)

    def _measure_period(self, now: float) -> bool:
        """Use the arrival of a text for the measurement. Return whether the period is known, which makes the sensor
        ready.
        """
        arrivals = self._arrivals
        arrivals.append(now)
        if len(arrivals) < self._profile.urcap_measured:
            return False
        period = linear_regression(range(len(arrivals)), [at - arrivals[0] for at in arrivals]).slope
        arrivals.clear()
        if not _LEAST_PERIOD_S <= period <= PERIOD_MAX_S:
            return False
        self._sensor_events.begin(SensorFacts("", _ONE, self._rated, None, period, 0.0, "host"))
        return True
