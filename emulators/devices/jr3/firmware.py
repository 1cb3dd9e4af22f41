"""Firmware of both gateways of a JR3 sensor: it reads and filters the sensor, zeroes, counts and streams.

It behaves as the firmware roboticslab-uc3m/jr3-mbed-firmware, which was read for facts only. A gateway adds the
wire and decides when the wire is read.

Some commands take time: they wait for the firmware's threads to end, or for the sensor's calibration. A gateway
does not read its wire while it executes such a command. It calls `begin` with the steps, then `finish`.
"""

import math
import random
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum, auto
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from emulators.devices.jr3.firmware_profile import FirmwareProfile
from emulators.devices.jr3.late import LateSamples, Sample
from emulators.devices.jr3.scales import WrongScales
from emulators.devices.jr3.sensor import SENSOR_RATE_HZ, Jr3Sensor
from emulators.faults.ledger import Handler, Injection
from protocol.devices.jr3 import COUNTER_MODULUS, GatewayState

_BLOCK = 4096
"""Maximum number of samples computed at once."""
_IDLE_S = 0.1
"""Maximum interval between computations of samples, s. Chosen: no call has to catch up on a long time."""


class Step(Enum):
    """Events that a command may have to wait for, in the order in which it waits."""

    JOIN_STREAM = auto()
    """End of the sending task, which occurs after the rest of its period."""
    JOIN_SAMPLING = auto()
    """End of the reading task, which occurs after a sample. It never occurs if no sensor is connected."""
    READ_CALIBRATION = auto()
    """Reception of the calibration, which arrives with the samples."""


STOP = (Step.JOIN_STREAM, Step.JOIN_SAMPLING)
RESET = (*STOP, Step.READ_CALIBRATION)
START = (Step.JOIN_STREAM,)
"""Steps of the commands that end a stream."""


@dataclass(slots=True)
class _Sampling:
    """Task that reads and filters the sensor, from start to stop."""

    started_at: float
    taken: int = 0
    """Number of samples so far: the frame counter before it wraps around."""
    read: int = 0
    """Number of samples read from the sensor so far. Some of them were read early and may never be used."""
    ahead: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 6)))
    """Counts of the newest samples read. Samples that have not been used yet are at the end."""


@dataclass(slots=True)
class _Stream:
    """Task that sends on the gateway's own clock: frame k is due at `anchor` + k · `period`.

    When a period is longer than `period`, `anchor` increases by the difference.
    """

    anchor: float
    period: float
    sent: int = 0
    due: float = field(init=False)
    """Time of the next frame, s."""
    ends: bool = False
    """Whether the task was ordered to end. It then sends nothing more, but completes its period."""

    def __post_init__(self) -> None:
        self.due = self.anchor

    def step(self, longer: float) -> None:
        """Advance by one frame. `longer` is the excess length of its period, s."""
        self.sent += 1
        self.anchor += longer
        self.due = self.anchor + self.sent * self.period


class _FrozenCounters:
    """Faults that freeze the counter at the value that it has when the fault first takes effect."""

    def __init__(self) -> None:
        self._counters: dict[Injection, int | None] = {}

    def begin(self, injection: Injection) -> None:
        """Begin a fault."""
        self._counters[injection] = None

    def apply(self, counter: int, at: float) -> int:
        """Return the counter that is reported at a time, s."""
        for injection, frozen in self._counters.items():
            if injection.holds(at):
                if frozen is None:
                    self._counters[injection] = frozen = counter
                injection.struck += frozen != counter
                counter = frozen
        return counter


class Firmware:
    """Firmware of a gateway. Times are in s and do not decrease.

    Commands take effect only once `initialised`; the gateway sends no command before that.
    """

    def __init__(self, sensor: Jr3Sensor, profile: FirmwareProfile, seed: int = 0) -> None:
        self._profile = profile
        self._late = LateSamples(profile.delay_ms, seed) if profile.delay_ms else None
        self._random = random.Random(f"{seed} period")
        self.plugged = sensor.profile.connected
        """Whether the sensor is plugged in."""
        self._steps: deque[Step] = deque()
        self._step_from = 0.0
        self.initialised = False
        """Whether the sensor's calibration has been read."""
        self._sensor = sensor
        sensor.on_invalidate.append(self._invalidate)
        self._scales = WrongScales()
        self._frozen_counters = _FrozenCounters()
        self._slow: list[Injection] = []
        self._sample_period = profile.sample_period_us * 1e-6
        self._smoothing = 1.0
        self._zero_requested = False
        self._streamed = False
        self._period_us = 0.0
        self._stream: _Stream | None = None
        self._sampling: _Sampling | None = None
        self._filtered: NDArray[np.float64] = np.zeros(6)
        self._offset: NDArray[np.float64] = np.zeros(6)

    @property
    def state(self) -> GatewayState:
        """State reported in acknowledgements."""
        return GatewayState.READY if self.initialised else GatewayState.NOT_INITIALISED

    @property
    def full_scales(self) -> tuple[int, ...]:
        """Full scales, six words. Without a calibration, the firmware sends the contents of its memory. Assumed:
        zeros.
        """
        if not self.initialised:
            return (0,) * 6
        words = self._sensor.profile.full_scale_words
        return self._scales.falsified(words) if self._scales.faulty else words

    @property
    def handlers(self) -> Mapping[str, Handler]:
        """Fault handlers for the target `sensor`, for a ledger."""
        return {
            **self._scales.handlers,
            "frozen-counter": Handler(self._frozen_counters.begin),
            "slow": Handler(self._slow.append),
            "unplugged": Handler(self._begin_unplugged, self._put_back),
        }

    # --- the sensor's plug

    def unplug(self, now: float) -> None:
        """Unplug the sensor. Its last sample and its counter remain. Idempotent."""
        if self.plugged:
            self._take_samples(now)
            self.plugged = False

    def plug_in(self, now: float) -> None:
        """Plug the same sensor in. Idempotent.

        A command that waits for the sensor continues. Assumed: an interrupted calibration is read from its start.
        """
        if self.plugged:
            return
        self.plugged = True
        self._step_from = max(self._step_from, now)
        if (sampling := self._sampling) is not None:
            sampling.started_at = now - sampling.taken * self._sample_period
            sampling.read, sampling.ahead = sampling.taken, sampling.ahead[:0]

    def _begin_unplugged(self, injection: Injection) -> None:
        injection.struck += self.plugged
        self.unplug(injection.injected_at)

    def _put_back(self, injection: Injection, now: float) -> None:
        self.plug_in(now)

    # --- what takes time

    @property
    def before_stream(self) -> tuple[Step, ...]:
        """Steps before a stream starts. The first start since power-up ends the sampling that is running."""
        return () if self._streamed else STOP

    def begin(self, steps: Iterable[Step], now: float) -> None:
        """Begin to wait for the steps of a command. A stream that is ending sends nothing more."""
        self._steps = deque(steps)
        self._step_from = now
        if Step.JOIN_STREAM in self._steps and self._stream is not None:
            self._stream.ends = True

    @property
    def busy_until(self) -> float:
        """Time at which the current step ends, s; infinite if only plugging in a sensor ends it."""
        blocked = self._profile.blocks and not self.plugged
        match self._steps[0]:
            case Step.JOIN_STREAM if self._stream is not None and self._profile.joins:
                return max(self._stream.due, self._step_from)
            case Step.JOIN_SAMPLING if self._sampling is not None and blocked:
                return math.inf
            case Step.READ_CALIBRATION:
                return math.inf if blocked else self._step_from + self._profile.calibration_s
            case _:
                return self._step_from

    def finish(self, now: float) -> float | None:
        """Complete the steps that are due. Return the time at which the last one ended, s, or None while one is in
        progress.
        """
        while self._steps:
            if (end := self.busy_until) > now:
                return None
            match self._steps.popleft():
                case Step.JOIN_STREAM:
                    self._stream = None
                case Step.JOIN_SAMPLING:
                    self.stop()
                    self.initialised = self.initialised and not self._steps
                case _:
                    self.initialised = True
            self._step_from = end
        return self._step_from

    # --- commands

    def start(self, cutoff_centihertz: int, now: float) -> None:
        """Sample, and send on request only. A stream ends; if sampling is already running, the counter continues."""
        self.set_filter(cutoff_centihertz, now)
        self._stream = None
        self._begin_sampling(now)

    def start_stream(self, cutoff_centihertz: int, period_us: int, now: float) -> None:
        """Sample, and send on the gateway's clock from now on. A running stream adopts the new period after the
        pending frame.
        """
        if not self._streamed:
            # The first start of a stream since power-up stops the sampling that is already running.
            self.stop()
            self._streamed = True
        self.set_filter(cutoff_centihertz, now)
        self._begin_sampling(now)
        self._period_us = period_us
        period = max(period_us, self._profile.shortest_period_us) * 1e-6
        self._stream = _Stream(now if self._stream is None else self._stream.due, period)

    def stop(self) -> None:
        """Discard stream, counter, filter state and offset. A pending zero remains pending."""
        self._stream = self._sampling = None
        self._filtered, self._offset = np.zeros(6), np.zeros(6)

    def zero(self, now: float) -> None:
        """Set the zero at the next sample, even if sampling starts only later."""
        self._take_samples(now)
        self._zero_requested = True

    def set_filter(self, cutoff_centihertz: int, now: float) -> None:
        """Set the cut-off frequency of the first-order low-pass. With 0, samples are not filtered."""
        self._take_samples(now)
        period = self._sample_period
        cutoff_hz = cutoff_centihertz / 100
        self._smoothing = period / (period + 1 / (2 * math.pi * cutoff_hz)) if cutoff_hz else 1.0

    # --- samples

    def sample(self, at: float) -> Sample | None:
        """Return the newest sample; None if sampling is stopped."""
        return None if self._sampling is None else self._newest(self._sampling, at)

    def due_samples(self, now: float) -> Iterator[Sample]:
        """Return the samples of the stream whose delay has passed."""
        samples = self._stream_samples(now)
        return samples if self._late is None else self._late.arrived(samples, now)

    def _stream_samples(self, now: float) -> Iterator[Sample]:
        """Return the samples of the stream that are due, each with the values at its own time."""
        stream, sampling = self._stream, self._sampling
        while stream is not None and sampling is not None and not stream.ends and stream.due <= now:
            yield self._newest(sampling, stream.due)
            for injection in self._slow:
                if injection.holds(stream.due):
                    stream.anchor += (injection.number("factor") - 1.0) * stream.period
                    injection.struck += 1
            stream.step(self._period_excess())

    def _period_excess(self) -> float:
        """Return the excess length of a period of the stream, s. Sending and waking up take time."""
        least, largest = self._profile.period_overhead_us
        if not largest:
            return 0.0
        period, shortest = self._period_us, self._profile.shortest_period_us
        overhead = self._random.uniform(least, largest)
        return (max(period + overhead, shortest) - max(period, shortest)) * 1e-6

    def sampled_at(self, counter: int) -> float | None:
        """Return the time at which the sensor measured the newest sample with this frame counter, s.

        None if there has been no such sample since the start.
        """
        sampling = self._sampling
        if sampling is None:
            return None
        number = sampling.taken - (sampling.taken - counter) % COUNTER_MODULUS
        if number <= 0:
            return None
        return (
            math.floor((sampling.started_at + number * self._sample_period) * SENSOR_RATE_HZ) / SENSOR_RATE_HZ
        )

    def next_deadline(self) -> float | None:
        """Return the time of the stream's next frame, including a delayed one, or of the next block of samples, s."""
        due = self._own_deadline()
        return due if self._late is None else self._late.next_deadline(due)

    def _own_deadline(self) -> float | None:
        sampling, stream = self._sampling, self._stream
        if sampling is None:
            return None
        due = stream.due if stream is not None and not stream.ends else math.inf
        if self.plugged:
            due = min(due, sampling.started_at + sampling.taken * self._sample_period + _IDLE_S)
        return due if due < math.inf else None

    def catch_up(self, now: float) -> None:
        """Process the block of samples that is due."""
        deadline = self._own_deadline()
        if deadline is not None and deadline <= now:
            self._take_samples(now)

    def _newest(self, sampling: _Sampling, at: float) -> Sample:
        self._take_samples(at)
        # Floor and wrap: the firmware shifts a fixed-point number right and sends its low 16 bits.
        zeroed = (self._filtered - self._offset).tolist()
        counts = [(math.floor(value) + 0x8000 & 0xFFFF) - 0x8000 for value in zeroed]
        return Sample(counts, self._frozen_counters.apply(sampling.taken % COUNTER_MODULUS, at))

    def _begin_sampling(self, now: float) -> None:
        if self._sampling is None:
            self._sampling = _Sampling(now)

    def _take_samples(self, until: float) -> None:
        """Read and filter the sensor's samples up to a time."""
        sampling = self._sampling
        if sampling is None or not self.plugged:
            return
        total = math.floor((until - sampling.started_at) / self._sample_period)
        while sampling.taken < total:
            last = min(total, sampling.taken + _BLOCK)
            if last > sampling.read:
                self._read(sampling, last)
            begin = len(sampling.ahead) - (sampling.read - sampling.taken)
            self._filter(sampling.ahead[begin : begin + last - sampling.taken])
            sampling.taken = last

    def _read(self, sampling: _Sampling, last: int) -> None:
        """Read the samples up to number `last`, and the following samples that the sensor predicts."""
        rest = sampling.ahead[len(sampling.ahead) - (sampling.read - sampling.taken) :]
        period, began = self._sample_period, sampling.started_at
        first = math.floor(((sampling.read + 1) * period + began) * SENSOR_RATE_HZ)
        counts = self._sensor.counts_from(first, math.floor((last * period + began) * SENSOR_RATE_HZ))
        newest = (first + len(counts) - 1) / SENSOR_RATE_HZ
        before, sampling.read = sampling.read, max(last, math.floor((newest - began) / period))
        times = np.arange(before + 1, sampling.read + 1) * period + began
        numbers = np.floor(times * SENSOR_RATE_HZ).astype(np.int64)
        sampling.ahead = np.concatenate((rest, counts.take(numbers - first, axis=0)))

    def _invalidate(self, first: int) -> None:
        """Drop the sensor's samples from this number on, because they will change."""
        sampling = self._sampling
        if sampling is None:
            return
        period, began = self._sample_period, sampling.started_at
        read = math.floor((first / SENSOR_RATE_HZ - began) / period) + 1
        while read > sampling.taken and math.floor((read * period + began) * SENSOR_RATE_HZ) >= first:
            read -= 1
        if read < sampling.read:
            sampling.ahead = sampling.ahead[: len(sampling.ahead) - (sampling.read - read)]
            sampling.read = read

    def _filter(self, counts: NDArray[np.float64]) -> None:
        """Apply the first-order low-pass, y += α (x − y); α may differ from the previous block."""
        difference = counts - self._filtered
        if self._zero_requested:
            self._zero_requested = False
            self._offset = self._filtered + self._smoothing * difference[0]
        # Only the last output of a block is sent, so the recursion is one weighted sum. The sum is relative to the
        # filter's current output, so that a constant input leaves the output exactly unchanged.
        weights = _impulse_response(self._smoothing, len(counts))
        self._filtered = self._filtered + weights.dot(
            difference
        )  # `@` gives the same result, but has a larger overhead


@lru_cache(maxsize=64)
def _impulse_response(smoothing: float, count: int) -> NDArray[np.float64]:
    """Return the weight of each of `count` samples, oldest first, in a first-order low-pass y += smoothing (x − y)."""
    return smoothing * (1.0 - smoothing) ** np.arange(count - 1, -1, -1.0)
