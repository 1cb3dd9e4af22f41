"""A microcontroller between a JR3 sensor's serial link and CAN.

Behaves as the firmware roboticslab-uc3m/jr3-mbed-firmware-can does, which was read for facts only.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from emulators.jr3.sensor import SENSOR_RATE_HZ, Jr3Sensor
from protocol.can import CanFrame
from protocol.endpoint import RemoteProtocolError
from protocol.jr3 import (
    COUNTER_MODULUS,
    Acknowledge,
    Command,
    GatewayState,
    Op,
    decode_command,
    encode_acknowledge,
    encode_sample,
    identifier,
)
from protocol.marks import Mark, check_settings, setting

_BLOCK = 4096
"""Most samples computed at once."""
_IDLE_S = 0.1
"""Chosen: samples are computed at least this often, so that no call has to catch up on a long time."""
_QUEUE = 32
"""Commands that the gateway keeps while it reads the calibration; more are lost. Source: firmware."""


@dataclass(frozen=True)
class GatewayProfile:
    """How a gateway behaves in time."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    node: int = setting(1, Mark.OBSERVED, "node number", minimum=1, maximum=127)
    boot_s: float = setting(2.0, Mark.OBSERVED, "deaf and silent after power-up", unit="s", minimum=0.0)
    calibration_s: float = setting(
        0.033, Mark.DERIVED, "reading the calibration: 256 bytes, one per sample", unit="s", minimum=0.0
    )
    sample_period_us: float = setting(
        128.5, Mark.OBSERVED, "between samples taken from the sensor", unit="µs", above=0.0
    )
    shortest_period_us: float = setting(
        260.0,
        Mark.DERIVED,
        "shortest period of the stream, that is two frames of 8 bytes at 1 Mbit/s",
        unit="µs",
        above=0.0,
    )

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(slots=True)
class _Sampling:
    """The task that reads and filters the sensor; it lives from start to stop."""

    started_at: float
    taken: int = 0
    """Samples so far: the frame counter before it wraps."""


@dataclass(slots=True)
class _Stream:
    """The task that sends by the gateway's own clock: frame k is due at `anchor` + k · `period`."""

    anchor: float
    period: float
    sent: int = 0

    @property
    def due(self) -> float:
        return self.anchor + self.sent * self.period


class Gateway:
    """Endpoint of the gateway: takes and gives sequences of CAN frames, tells no events."""

    def __init__(self, profile: GatewayProfile, sensor: Jr3Sensor, powered_at: float) -> None:
        self._profile = profile
        self._sensor = sensor
        self._sample_period = profile.sample_period_us * 1e-6
        self._hears_from = powered_at + profile.boot_s
        self._out: list[CanFrame] = []
        self._waiting: deque[Command] = deque()
        self._initialised = False
        self._smoothing = 1.0
        self._zero_requested = False
        self._stream: _Stream | None = None
        self._sampling: _Sampling | None = None
        self._filtered: NDArray[np.float64] = np.zeros(6)
        self._offset: NDArray[np.float64] = np.zeros(6)
        connected = sensor.profile.connected
        self._busy_with: Op | None = Op.BOOT_UP if connected else None
        self._busy_until = self._hears_from + profile.calibration_s

    # --- endpoint

    def receive(self, data: Sequence[CanFrame], now: float) -> None:
        """Take frames; those of other nodes, unknown ops and anything during boot get no answer."""
        self.handle_deadline(now)
        if now < self._hears_from:
            return
        for frame in data:
            if frame.extended or frame.remote or frame.error:
                continue
            try:
                command = decode_command(frame)
            except RemoteProtocolError:
                continue
            if command.op is Op.SYNC:
                self._on_sync(now)
            elif command.node != self._profile.node:
                continue
            elif self._busy_with is None:
                self._on_command(command, now)
            elif len(self._waiting) < _QUEUE:
                self._waiting.append(command)

    def next_event(self) -> None:
        """A gateway tells nothing."""

    def data_to_send(self, now: float) -> Sequence[CanFrame]:
        """Frames whose time has come."""
        frames, self._out = self._out, []
        return frames

    def next_deadline(self) -> float | None:
        """End of reading the calibration, the next frame of the stream, or the next block of samples."""
        if self._busy_with is not None:
            return self._busy_until
        if self._sampling is None:
            return None
        block = self._sampling.started_at + self._sampling.taken * self._sample_period + _IDLE_S
        return block if self._stream is None else min(self._stream.due, block)

    def handle_deadline(self, now: float) -> None:
        """Emit every frame that is due up to and including now."""
        if self._busy_with is not None and now >= self._busy_until:
            self._on_calibration_read(self._busy_with)
        self._send_due(now)
        deadline = self.next_deadline()
        if self._busy_with is None and deadline is not None and deadline <= now:
            self._take_samples(now)

    # --- commands

    def _on_command(self, command: Command, now: float) -> None:
        if not self._initialised:
            self._acknowledge(command.op)
            return
        match command.op:
            case Op.START_SYNC:
                self._set_filter(command, now)
                self._stream = None
                self._begin_sampling(now)
            case Op.START_ASYNC:
                self._set_filter(command, now)
                self._begin_sampling(now)
                self._begin_stream(command, now)
            case Op.STOP:
                self._stream = None
                self._end_sampling()
            case Op.ZERO:
                self._take_samples(now)
                self._zero_requested = True
            case Op.SET_FILTER:
                self._set_filter(command, now)
            case Op.RESET:
                self._stream = None
                self._end_sampling()
                self._initialised = False
                self._busy_with, self._busy_until = Op.RESET, now + self._profile.calibration_s
                return
            case _:  # the queries only want the acknowledge
                pass
        self._acknowledge(command.op)

    def _on_sync(self, now: float) -> None:
        if self._busy_with is None and self._sampling is not None:
            self._send_sample(now)

    def _on_calibration_read(self, why: Op) -> None:
        self._busy_with, self._initialised = None, True
        if why is Op.BOOT_UP:
            self._out.append(CanFrame(identifier(Op.BOOT_UP, self._profile.node)))
        else:
            self._acknowledge(why)
        at = self._busy_until
        while self._waiting and self._busy_with is None:
            self._on_command(self._waiting.popleft(), at)

    def _acknowledge(self, op: Op) -> None:
        state = GatewayState.READY if self._initialised else GatewayState.NOT_INITIALISED
        words = None
        if op in (Op.GET_FORCE_FULL_SCALES, Op.GET_MOMENT_FULL_SCALES):
            first = 0 if op is Op.GET_FORCE_FULL_SCALES else 3
            # Without a calibration the firmware sends whatever lies in its memory. Assumed: zeros.
            known = self._sensor.profile.full_scale_words if self._initialised else (0,) * 6
            words = (known[first], known[first + 1], known[first + 2])
        self._out.append(encode_acknowledge(self._profile.node, Acknowledge(state, words)))

    # --- stream

    def _begin_stream(self, command: Command, now: float) -> None:
        period = max(command.period_us, self._profile.shortest_period_us) * 1e-6
        # A running stream takes the new period after the frame that it waits for.
        self._stream = _Stream(now if self._stream is None else self._stream.due, period)
        self._send_due(now)

    def _send_due(self, now: float) -> None:
        while self._stream is not None and self._stream.due <= now:
            self._send_sample(self._stream.due)
            self._stream.sent += 1

    def _send_sample(self, at: float) -> None:
        self._take_samples(at)
        # Floor and wrap: the firmware shifts a fixed-point number right and sends its low 16 bits.
        counts = np.floor(self._filtered - self._offset).astype(np.int64).astype(np.int16)
        taken = 0 if self._sampling is None else self._sampling.taken
        self._out.extend(encode_sample(self._profile.node, counts.tolist(), taken % COUNTER_MODULUS))

    # --- samples

    def _begin_sampling(self, now: float) -> None:
        if self._sampling is None:
            self._sampling = _Sampling(now)

    def _end_sampling(self) -> None:
        """Forget counter, filter state and offset; a zero that waits for its sample stays."""
        self._sampling = None
        self._filtered, self._offset = np.zeros(6), np.zeros(6)

    def _set_filter(self, command: Command, now: float) -> None:
        self._take_samples(now)
        cutoff_hz = command.cutoff_centihertz / 100
        period = self._sample_period
        self._smoothing = period / (period + 1 / (2 * math.pi * cutoff_hz)) if cutoff_hz else 1.0

    def _take_samples(self, until: float) -> None:
        """Read and filter what the sensor has given up to a time."""
        sampling = self._sampling
        if sampling is None:
            return
        total = math.floor((until - sampling.started_at) / self._sample_period)
        while sampling.taken < total:
            last = min(total, sampling.taken + _BLOCK)
            times = np.arange(sampling.taken + 1, last + 1) * self._sample_period + sampling.started_at
            self._filter(self._sensor.counts(np.floor(times * SENSOR_RATE_HZ).astype(np.int64)))
            sampling.taken = last

    def _filter(self, counts: NDArray[np.int64]) -> None:
        """First-order low pass, y += α (x − y); α may differ from the block before."""
        away = counts - self._filtered
        if self._zero_requested:
            self._zero_requested = False
            self._offset = self._filtered + self._smoothing * away[0]
        # Of a block only the last output is ever sent, so the recursion is one weighted sum; taken from where
        # the filter stands, so that a constant input leaves it exactly there.
        self._filtered = self._filtered + _impulse_response(self._smoothing, len(counts)) @ away


@lru_cache(maxsize=64)
def _impulse_response(smoothing: float, count: int) -> NDArray[np.float64]:
    """Weight of each of `count` samples, oldest first, in a first-order low pass y += smoothing (x − y)."""
    return smoothing * (1.0 - smoothing) ** np.arange(count - 1, -1, -1.0)
