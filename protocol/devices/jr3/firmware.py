"""Parts that both gateways of a JR3 sensor share, for one firmware runs in both: filter, counter, payloads.

Source: firmware roboticslab-uc3m/jr3-mbed-firmware, read for facts. Payloads are little-endian.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from enum import IntEnum

from protocol.fields import Field, Layout
from protocol.marks import Mark, SettingError
from protocol.wrench import SensorStatistics

COUNTER_MODULUS = 65536
"""The firmware counts its samples of the sensor, about 7782 a second, in 16 bits: 8.4 s to the wrap."""
MAX_CUTOFF_HZ = 655.35
SMALLEST_CUTOFF_HZ = 0.01
"""One unit of the wire. What would be rounded to 0 there would switch the filter off instead of closing it."""

UNFILTERED = "the gateway's filter is off (cut-off 0): every sample is as noisy as the sensor"
"""Notice of a client about a cut-off of 0, which may be meant or a slip."""


TESTED_PERIOD_MS = 1.0
"""Shortest period of a stream that the firmware was tested with. Source: firmware's own notes."""
HANGS = "it may hang since its sensor was unplugged: plug the sensor in, then switch the gateway off and on"
"""Remedy for a gateway that does not answer: its program may wait for its sensor. Source: firmware."""


class GatewayState(IntEnum):
    """First byte of an acknowledge."""

    READY = 0
    NOT_INITIALISED = 1
    """No sensor was found at power-up: commands are acknowledged and have no effect."""


def payload_layout(name: str, size: int, *fields: Field) -> Layout:
    """Return the layout of a gateway's payload."""
    return Layout(name, size, "<", fields)


def axis_fields(axes: Sequence[str], like: Field) -> list[Field]:
    """One field of two bytes for each axis, in a row from this one on, which is like them but for the name."""
    return [replace(like, name=axis, offset=like.offset + 2 * place) for place, axis in enumerate(axes)]


STATE = Field("state", 0, "B", Mark.OBSERVED, "0 ready, 1 not initialised")
_CUTOFF = Field(
    "cutoff", 0, "H", Mark.OBSERVED, "cut-off of the first-order filter, 0 = unfiltered", 0.01, "Hz"
)


def counter_field(offset: int) -> Field:
    """Return the field of the counter that ends every sample."""
    return Field("counter", offset, "H", Mark.OBSERVED, "sensor samples since the start, modulo 65536")


EMPTY = payload_layout("no data", 0)
CUTOFF = payload_layout("cut-off", 2, _CUTOFF)
START = payload_layout(
    "asynchronous start", 6, _CUTOFF, Field("period", 2, "I", Mark.OBSERVED, "between frames", 1e-6, "s")
)
ACKNOWLEDGE = payload_layout("acknowledge", 1, STATE)


def read_start(payload: bytes) -> tuple[int, int]:
    """Cut-off in 0.01 Hz and period in µs as the firmware reads them: what is not there as a whole counts as 0."""
    whole = 6 if len(payload) >= 6 else 2 if len(payload) >= 2 else 0
    raw = START.unpack(payload[:whole].ljust(6, b"\0"))
    return int(raw["cutoff"]), int(raw["period"])


def first_order_delay(cutoff_hz: float) -> float:
    """1/(2π f_c) of a first-order low pass, s; 0 means unfiltered. Source: textbook delay at low frequencies."""
    return 1.0 / (2.0 * math.pi * cutoff_hz) if cutoff_hz else 0.0


def check_cutoff(cutoff_hz: float) -> None:
    """Raise ValueError for a cut-off that a gateway cannot be told; 0 is one that it can."""
    if not 0.0 <= cutoff_hz <= MAX_CUTOFF_HZ or 0.0 < cutoff_hz < SMALLEST_CUTOFF_HZ:
        raise SettingError(
            "cutoff_hz",
            f"must be {SMALLEST_CUTOFF_HZ} … {MAX_CUTOFF_HZ}, or 0 for unfiltered, got {cutoff_hz:g}",
        )


class SampleCounter:
    """Follows the counter of the samples that arrive over its wraps, and counts what is missing or came again."""

    __slots__ = ("_last", "_sequence", "_statistics", "_step", "_straggler_from")

    def __init__(self, statistics: SensorStatistics, step: float, behind: int) -> None:
        """`step` is what the counter grows by from frame to frame. A frame whose
        counter is less than `behind` before the last one is an old frame; by more, it is a far step forward.
        """
        self._statistics = statistics
        self._step = step
        self._straggler_from = COUNTER_MODULUS - behind
        self._last: int | None = None
        self._sequence: int | None = None

    def restart(self) -> None:
        """Follow a device that starts counting again; the sequence advances by 1."""
        self._last = None
        self._statistics.standing = 0

    def follow(self, counter: int) -> int | None:
        """Return the sequence of this sample, or None for a repeated one."""
        if self._last is None:
            self._sequence = counter if self._sequence is None else self._sequence + 1
        else:
            step = (counter - self._last) % COUNTER_MODULUS
            if step == 0 or step > self._straggler_from:
                self._statistics.repeated += 1
                self._statistics.standing += step == 0
                return None
            self._sequence = (self._sequence or 0) + step
            if (missing := round(step / self._step) - 1) > 0:
                self._statistics.lost += missing
        self._last = counter
        self._statistics.standing = 0
        return self._sequence
