"""Decoder of samples from bursts of a receiver board's registers, with their warning and error bits."""

import struct

from protocol.devices.jr3.board import REGISTERS, SATURATIONS, Errors
from protocol.devices.jr3.range import Range
from protocol.devices.jr3.registers.profile import BoardClientProfile, filter_tick
from protocol.devices.jr3.registers.startup import DEAF, NEW
from protocol.devices.jr3.registers.telegrams import BURST
from protocol.sensor_events import SensorEventQueue
from protocol.wrench import AXES, SensorStatistics, WrenchFrame

_COUNTER_MODULUS = 65536
_DETECTABLE_S = 0.03
"""Longest time between two samples with which the reading of a calibration is always detected, s. Derived: a board
reads a calibration for 33 ms.
"""
_STUCK_S = 0.02
"""Time without new samples from which the board has been reading a calibration, s. Chosen: longer than a command of
another client keeps the board busy, and shorter than the reading of a calibration.
"""
_QUIET_S = 1.0
"""Time without saturation after which saturation is reported again, s. Chosen."""
# plain numbers: an operation on flags costs as much as the rest of a sample
_TROUBLE, _NEW = int(DEAF | NEW), int(NEW)
_BUSY = int(Errors.SYSTEM_BUSY)


class SampleLayout:
    """Memory layout of a filter's samples: a burst from the filter's first word up to the word `errors`."""

    def __init__(self, number: int) -> None:
        """Determine the layout for the filter `number`."""
        self.first = REGISTERS[f"filter{number}"].address
        # filter0 has no counter of its own; it runs at the rate of filter1
        counter_at = REGISTERS[f"count{max(number, 1)}"].address - self.first
        warnings_at = REGISTERS["warnings"].address - self.first
        self.words = REGISTERS["errors"].address - self.first + 1
        # time stamp, axes, counter, warnings and errors of a burst; the words between them are ignored
        self.burst = struct.Struct(
            f">Q6h{2 * (counter_at - len(AXES))}xH{2 * (warnings_at - counter_at - 1)}x2H"
        )


class Saturations:
    """Record of the axes that are saturated or nearly saturated.

    Each axis is reported once, and again only after a time without saturation, because a contact at the limit would
    cause many reports.
    """

    def __init__(self, now: float) -> None:
        self.known = 0
        """Bits of the axes that have been reported."""
        self._known_until = now

    def note(self, errors: int, warnings: int, now: float) -> str:
        """Return the text of a notice about newly set bits, or an empty string."""
        present = errors << len(AXES) | warnings
        if not (present or self.known):
            return ""
        if present:
            self._known_until = now + _QUIET_S
        elif now >= self._known_until:
            self.known = 0
        new = present & ~self.known
        if not new:
            return ""
        self.known |= new
        texts = [f"{axis} saturated" for i, axis in enumerate(AXES) if new >> (len(AXES) + i) & 1]
        texts += [f"{axis} near saturation" for i, axis in enumerate(AXES) if new >> i & 1]
        return f"board: raw {', '.join(texts)}"


class SampleReader:
    """Decoder that converts bursts to frames and reports them."""

    def __init__(
        self,
        profile: BoardClientProfile,
        burst: struct.Struct,
        events: SensorEventQueue,
        statistics: SensorStatistics,
        now: float,
    ) -> None:
        self._burst, self._sensor_events, self._statistics = burst, events, statistics
        self._period = profile.period
        self._longest_ns = 1.25e9 * profile.period
        """Longest difference between two time stamps if no burst is missing, including a tolerance for a late
        burst, ns.
        """
        self._tick = filter_tick(profile.filter)
        self._may_miss = profile.period > _DETECTABLE_S
        """Whether the time between samples is so long that a change of the sensor between two of them may be missed."""
        self.range = Range()
        self._saturations = Saturations(now)
        self.counter: int | None = None
        """Counter of the newest sample; None before the first."""
        self._counted_ns = 0
        self._sequence: int | None = None
        self._stamp_ns: int | None = None
        self._sample_time = self.sampled_at = now
        """Sampling time of the newest frame, s."""

    def begin(self, now: float) -> None:
        """Begin the stream, or continue it after a restart of the board."""
        self.counter = self._stamp_ns = None
        self.sampled_at = now

    def read(self, data: bytes, begin: int, end: int, now: float) -> int:
        """Process the bursts from index `begin` to index `end` of the data. Return the error bits that mean that
        the sensor is lost, or 0.
        """
        unpack, size = self._burst.unpack_from, self._burst.size
        # a single burst is the newest, regardless of its time
        newest = int.from_bytes(data[end - size : end - size + BURST.size]) if end - begin > size else 0
        for place in range(begin, end, size):
            time_ns, fx, fy, fz, mx, my, mz, counter, warnings, errors = unpack(data, place)
            # The clocks of two machines cannot be compared, so the newest burst gets its arrival time.
            at = now if time_ns >= newest else now - (newest - time_ns) * 1e-9
            if at > self._sample_time:
                self._sample_time = at
            if self._stamp_ns is not None and time_ns - self._stamp_ns > self._longest_ns:
                periods = (time_ns - self._stamp_ns) * 1e-9 / self._period
                self._statistics.lost += max(0, round(periods) - 1)
            self._stamp_ns = time_ns
            if errors or warnings or self._saturations.known:
                if errors & _TROUBLE:
                    return int(errors)
                text = self._saturations.note(errors & SATURATIONS, warnings & SATURATIONS, now)
                if text:
                    self._sensor_events.notice(text)
                if errors & _BUSY:
                    continue  # the data is stale
            sequence = self._sequence
            if sequence is None:
                sequence = counter
            elif self.counter is None:
                sequence += 1
            elif counter == self.counter:
                self._statistics.repeated += 1
                continue
            else:
                step = (counter - self.counter) % _COUNTER_MODULUS
                if self._may_miss and self._was_stuck((time_ns - self._counted_ns) * 1e-9, step):
                    return _NEW
                sequence += step
            self._sequence, self.counter, self.sampled_at = sequence, counter, now
            self._counted_ns = time_ns
            counts = fx, fy, fz, mx, my, mz
            saturated = self.range.saturated(counts)
            for warning in self.range.warnings:
                self._sensor_events.notice(warning)
            self._sensor_events.tell(WrenchFrame(counts, counter, sequence, self._sample_time, saturated))
        return 0

    def _was_stuck(self, elapsed: float, step: int) -> bool:
        """Return whether the counter, which advanced by `step` within `elapsed`, s, was stopped for some of that
        time.
        """
        wrap = _COUNTER_MODULUS * self._tick
        missing = (elapsed - step * self._tick) % wrap
        return _STUCK_S + self._tick < missing < wrap / 2
