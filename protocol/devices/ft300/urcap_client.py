"""Client of an FT 300 behind Robotiq's URCap: it sends nothing, measures the period of the texts, and tells them.

The URCap numbers nothing, so the client counts the texts. It sleeps 10 ms between two of them and works for a while, so
its period is no device's clock: the client measures it before the first force. Its zero is taken over another port and
is common to all its clients; the zero of a run is the host's.
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
"""Chosen: as of the sensor's own stream. The URCap repeats a value where no new one has come, but a period later."""
_LEAST_PERIOD_S = 1e-3
"""Chosen: texts that come faster have waited somewhere, and are not measured."""
_ONE: Wrench = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0)


class UrcapClient(Due):
    """Endpoint of bytes: a `SensorClient`."""

    def __init__(self, profile: Ft300ClientProfile, now: float) -> None:
        self.statistics = SensorStatistics()
        self.stop_patience = 0.1
        self._profile = profile
        self._rated: Wrench = (*(profile.rated_n,) * 3, *(profile.rated_nm,) * 3)
        self._sensor_events = telling = SensorEventQueue(
            zero_samples=max(1, round(profile.zero_s / PERIOD_S))
        )
        self.next_event, self.zero = telling.next_event, telling.zero
        self._patience = profile.tries * profile.answer_timeout_s
        self._due: float | None = now + self._patience
        self._reader = TextReader()
        self._arrivals: list[float] = []
        """When the texts came by which the period is measured, s."""
        self._count = 0
        self._newest: Wrench | None = None
        """Values of the text that came last, and when it did, s."""
        self._newest_at = 0.0

    def receive(self, data: bytes, now: float) -> None:
        """Take bytes."""
        if self._sensor_events.ended:
            return
        reader, statistics = self._reader, self.statistics
        noises, missed = reader.noises, reader.missed
        texts = reader.feed(data)
        statistics.malformed += reader.noises - noises
        if self._newest is not None:  # a stream that is joined begins anywhere
            statistics.lost += reader.missed - missed
        for values in texts:
            self._take(values, now)

    def data_to_send(self, now: float) -> bytes:
        """Nothing, ever."""
        return b""

    def handle_deadline(self, now: float) -> None:
        """Give up."""
        if self._due is None or now < self._due:
            return
        self._due = None
        if self._newest is None:
            self._sensor_events.fail(
                f"the URCap has sent nothing for {self._patience:g} s",
                "look whether the URCap shows the sensor, and end other clients: it serves one at a time",
            )
        else:
            self._sensor_events.fail(
                f"no text came for {self._profile.silence_s:g} s", "look whether the URCap shows the sensor"
            )

    def stop(self) -> None:
        """End the session."""
        if not self._sensor_events.ended:
            self._due = None
            self._sensor_events.stop()

    def _take(self, values: Wrench, now: float) -> None:
        self._due = now + self._profile.silence_s
        if values == self._newest and now - self._newest_at < _COPY_PERIODS * PERIOD_S:
            self.statistics.repeated += 1
            return
        self._newest, self._newest_at = values, now
        self._count += 1
        if not self._sensor_events.ready and not self._measured(now):
            return
        saturated = 0
        for axis, (value, rated) in enumerate(zip(values, self._rated, strict=True)):
            saturated |= (abs(value) >= rated) << axis
        self._sensor_events.numbered_sample(values, self._count, self._count, now, saturated)

    def _measured(self, now: float) -> bool:
        """Whether the period is known now, which makes the sensor ready."""
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
