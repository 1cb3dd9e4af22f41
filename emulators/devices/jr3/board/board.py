"""JR3 DSP receiver board: a memory that a sensor fills and that a host reads and writes; the caller passes the
time.

Samples are computed in blocks up to the requested time, and further as far as the sensor predicts, so that a read
is a look-up. A host's write that affects the computation discards the samples computed ahead. A change of the
sensor's predicted samples also discards them.
"""

import math
import struct
from collections.abc import Callable, Mapping, Sequence
from enum import Enum, auto
from typing import Self

from emulators.devices.jr3.board.filters import FILTER_STEPS
from emulators.devices.jr3.board.memory import Use
from emulators.devices.jr3.board.processor import Order, Processor, default_full_scales
from emulators.devices.jr3.board.profile import BoardProfile
from emulators.devices.jr3.board.sampling import RawSamples
from emulators.devices.jr3.faults import SECOND
from emulators.devices.jr3.scales import WrongScales
from emulators.devices.jr3.sensor import SENSOR_RATE_HZ, Jr3Sensor
from emulators.faults.ledger import Handler, Injection
from protocol.devices.jr3 import AXES
from protocol.devices.jr3.board import (
    REGISTERS,
    WORD_MODULUS,
    Errors,
    check_instructions,
    check_range,
    from_signed,
)

_EPSILON = 1e-6
"""Share of a sample period by which a time may be too early because of rounding."""
_AHEAD_S = 1.0
"""Limit of the computation ahead for a source that is committed for ever, s. It is never reached."""
_FULL_SCALES = REGISTERS["full_scale"].address
_COMMAND_WORDS = REGISTERS["command_word2"].address


class Phase(Enum):
    """Phases of the board's start."""

    BOOT = auto()
    SILENT = auto()
    """No samples arrive, but the watchdog has not detected this yet."""
    UNPLUGGED = auto()
    READING = auto()
    """The calibration is being received."""
    RUNNING = auto()


class _Due(Enum):
    """Events that are due at a time. Events with equal times are processed in this order."""

    BOOTED = auto()
    CALIBRATED = auto()
    BARK = auto()
    ZEROED = auto()
    ADOPT = auto()
    COMMAND = auto()


class Board:
    """Implementation of `protocol.devices.jr3.board.Registers`.

    A host's write raises an error, RemoteProtocolError, only for words outside the memory. A command written while
    another is running is lost (assumed).
    """

    def __init__(
        self, profile: BoardProfile, sensor: Jr3Sensor, powered_at: float, filter_number: int = 0
    ) -> None:
        """Power up. `filter_number`, 0 … 6, is the filter that the client reads. Only `sampled_at` uses it."""
        self.jr3 = sensor
        """Connected sensor."""
        self._filter_read = filter_number
        self._profile = profile
        self._sensor = sensor
        sensor.on_invalidate.append(self._invalidate)
        self._raw = RawSamples(sensor)
        self._scales = WrongScales()
        self._plugged = sensor.profile.connected
        self._first = sensor.profile
        self._holds_second = False
        self._now = powered_at
        self._phase = Phase.BOOT
        self._start(powered_at)

    def _start(self, now: float) -> None:
        self._origin = math.ceil(now * SENSOR_RATE_HZ - _EPSILON)
        self._processor = Processor(self._profile, self._sensor, self._raw, self._origin)
        self._order: Order | None = None
        self._due: dict[_Due, float] = {}
        self._set_phase(Phase.BOOT)
        self._due[_Due.BOOTED] = now + self._profile.boot_s

    # --- a host's side

    def read(self, address: int, count: int, now: float) -> tuple[int, ...]:
        """Return raw words 0…65535, all of the same sample. Raises RemoteProtocolError outside the memory."""
        check_range(address, count)
        self._advance(now)
        words = self._processor.read(address, count)
        return tuple(self._falsify(address, words) if self._scales.faulty else words)

    def burst(self, address: int, count: int, now: float) -> bytes:
        """Return the words of `read` as bytes for a wire. Raises RemoteProtocolError outside the memory."""
        check_range(address, count)
        self._advance(now)
        if self._scales.faulty:
            return struct.pack(f">{count}H", *self._falsify(address, self._processor.read(address, count)))
        return self._processor.burst(address, count)

    def _falsify(self, address: int, words: Sequence[int]) -> Sequence[int]:
        """Falsify the full scales among words read by a host."""
        at = _FULL_SCALES - address
        if not 0 <= at <= len(words) - len(AXES):
            return words
        end = at + len(AXES)
        return (*words[:at], *self._scales.falsified(words[at:end]), *words[end:])

    @property
    def handlers(self) -> Mapping[str, Mapping[str, Handler]]:
        """Fault handlers of the receiver and the sensor, by target, for a ledger."""
        return {
            "signal": self.jr3.signal.handlers,
            "sensor": {**self._scales.handlers, "unplugged": Handler(self._begin_unplugged, self._put_back)},
        }

    @property
    def endpoint(self) -> Self:
        """The board itself: the registers that a host reads."""
        return self

    def _begin_unplugged(self, injection: Injection) -> None:
        if injection.values["sensor"] == SECOND:
            default_full_scales(
                self._profile, self._profile.second.of(self._first)
            )  # raises an error if the sensor cannot be plugged in
        injection.struck += self._plugged
        self.unplug(injection.injected_at)

    def _put_back(self, injection: Injection, now: float) -> None:
        self.plug_in(now, second=injection.values["sensor"] == SECOND)

    def write(self, address: int, words: Sequence[int], now: float) -> None:
        """Write words in order of address. Raises RemoteProtocolError outside the memory."""
        check_range(address, len(words))
        self._advance(now)
        for offset, word in enumerate(words):
            self._write(address + offset, from_signed(word))

    def read_word(self, address: int, now: float) -> int:
        """Return one word, 0…65535. Raises RemoteProtocolError outside the memory."""
        return self.read(address, 1, now)[0]

    def write_word(self, address: int, value: int, now: float) -> None:
        """Write one word; a negative value is stored as two's complement. Raises RemoteProtocolError outside the
        memory.
        """
        self.write(address, (value,), now)

    def command(self, code: int, now: float, word1: int = 0, word2: int = 0) -> float:
        """Write the three command words. Return the time at which command_word0 will be cleared or become negative,
        s.
        """
        self.write(_COMMAND_WORDS, (word2, word1, code), now)
        return self._due.get(_Due.COMMAND, self._now)

    def reset(self, now: float) -> None:
        """Restart the board's program. Assumed: words written by the host are lost."""
        self._advance(now)
        self._processor.sampling.cut()
        self._start(self._now)

    def load(self, address: int, words: Sequence[int], now: float) -> None:
        """Reset the board for a program, or accept instructions. Instructions are ignored: the board runs its own
        program.

        Raises RemoteProtocolError for data that cannot be loaded into a processor.
        """
        check_instructions(address, words)
        if not words:
            self.reset(now)

    # --- the truth, which no wire tells

    def sampled_at(self, counter: int) -> float | None:
        """Return the time at which the sensor measured the newest sample with this count that a host has read, s.

        The count is that of the filter that the client reads; filter 0 uses the count of filter 1. None if there
        has been no such sample since the reset.
        """
        number = max(self._filter_read, 1)
        step, sampling = FILTER_STEPS[number], self._processor.sampling
        (newest,) = self._processor.read(REGISTERS[f"count{number}"].address, 1)
        behind = (newest - counter) % WORD_MODULUS
        sample = sampling.sample - sampling.sample % step - behind * step
        return (self._origin + sample) / SENSOR_RATE_HZ if sample >= 0 else None

    # --- the sensor's plug

    def unplug(self, now: float) -> None:
        """Unplug the sensor. Idempotent."""
        self._advance(now)
        if not self._plugged:
            return
        self._plugged = False
        if self._phase is Phase.BOOT:
            return
        for due in (_Due.CALIBRATED, _Due.ZEROED):
            self._due.pop(due, None)
        self._processor.lose_sensor(zero=False)
        self._set_phase(Phase.SILENT)
        self._due[_Due.BARK] = self._now + self._profile.watch_dog_s

    def plug_in(self, now: float, *, second: bool = False) -> None:
        """Plug in the first or the second sensor. No effect if a sensor is already connected."""
        self._advance(now)
        if self._plugged:
            return
        self._plugged, self._holds_second = True, second
        self._sensor.exchange(self._profile.second.of(self._first) if second else self._first, self._now)
        if self._phase is not Phase.BOOT:
            self._due.pop(_Due.BARK, None)
            self._begin_reading(self._now)

    # --- time

    def _sample_at(self, time: float) -> int:
        """Return the number of the newest sample at a time."""
        return math.floor(time * SENSOR_RATE_HZ + _EPSILON) - self._origin

    def _advance(self, now: float) -> None:
        if now < self._now:
            now = self._now
        self._now = now
        while self._due:
            due = min(self._due, key=lambda key: (self._due[key], key.value))
            at = self._due[due]
            if at > now:
                break
            del self._due[due]
            self._run(at)
            _HANDLERS[due](self, at)
        self._run(now)

    def _run(self, time: float) -> None:
        processor, sample = self._processor, self._sample_at(time)
        if processor.sampling.reach(sample):
            return
        computing = self._phase is Phase.RUNNING and not (self._order and self._order.busy)
        settings = processor.settings if computing else None
        processor.sampling.run(sample, settings, self._find_predicted_sample)

    def _invalidate(self, first: int) -> None:
        self._processor.sampling.invalidate(first)

    def _find_predicted_sample(self) -> int:
        """Return the number of the last sample that can be computed now and will most likely be needed."""
        sample = self._sample_at(min(self._sensor.predicted_until(self._now), self._now + _AHEAD_S))
        return min(sample, self._sample_at(min(self._due.values()))) if self._due else sample

    # --- events

    def _set_phase(self, phase: Phase) -> None:
        self._phase = phase
        status = self._processor.memory.status & int(Errors.SENSOR_CHANGE)
        if self._order and self._order.busy:
            status |= int(Errors.SYSTEM_BUSY)
        if phase is Phase.UNPLUGGED:
            status |= self._profile.unplugged_errors
        elif phase in (Phase.BOOT, Phase.READING):
            status |= int(Errors.CALIBRATION_CRC | Errors.SYSTEM_BUSY)
        self._processor.memory.status = status

    def _on_boot(self, at: float) -> None:
        if self._plugged:
            self._begin_reading(at)
        else:
            self._set_phase(Phase.UNPLUGGED)

    def _begin_reading(self, at: float) -> None:
        self._processor.forget_sensor()
        self._set_phase(Phase.READING)
        self._due[_Due.CALIBRATED] = at + self._profile.calibration_s

    def _on_calibration(self, at: float) -> None:
        self._processor.identify_sensor(self._profile.second if self._holds_second else None)
        self._set_phase(Phase.RUNNING)
        self._due[_Due.ZEROED] = at + self._profile.offsets_zeroed_s

    def _bark(self, _at: float) -> None:
        self._processor.lose_sensor(zero=self._profile.unplugged_data == "zero")
        self._set_phase(Phase.UNPLUGGED)

    def _on_zero(self, _at: float) -> None:
        self._processor.zero_offsets()

    def _adopt(self, _at: float) -> None:
        self._processor.adopt()

    def _command_done(self, _at: float) -> None:
        if self._order:
            order, self._order = self._order, None
            self._processor.finish(order)
            self._set_phase(self._phase)

    # --- writes

    def _write(self, address: int, word: int) -> None:
        match self._processor.write(address, word):
            case Use.ADOPT:
                self._adopt_soon()
            case Use.COMMAND if word and self._order is None:
                order, seconds = self._processor.begin()
                self._order = order
                self._due[_Due.COMMAND] = self._now + seconds

    def _adopt_soon(self) -> None:
        """Schedule the reading of the host's words before the next sample whose number is a multiple of the period."""
        period = self._profile.adoption_samples
        sample = (self._processor.sampling.sample // period + 1) * period
        self._due.setdefault(_Due.ADOPT, (self._origin + sample - 0.5) / SENSOR_RATE_HZ)


_HANDLERS: dict[_Due, Callable[[Board, float], None]] = {
    _Due.BOOTED: Board._on_boot,
    _Due.CALIBRATED: Board._on_calibration,
    _Due.BARK: Board._bark,
    _Due.ZEROED: Board._on_zero,
    _Due.ADOPT: Board._adopt,
    _Due.COMMAND: Board._command_done,
}
