"""Firmware properties common to both gateways of a JR3 sensor: filter, counter, payloads.

Source: firmware roboticslab-uc3m/jr3-mbed-firmware, consulted for facts. Payloads are little-endian.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from enum import IntEnum

from protocol.fields import Field, Layout
from protocol.marks import Mark, SettingError
from protocol.wrench import SensorStatistics

COUNTER_MODULUS = 65536
"""Modulus of the firmware's 16-bit counter. It counts about 7782 sensor samples per second and wraps around every
8.4 s.
"""
MAX_CUTOFF_HZ = 655.35
SMALLEST_CUTOFF_HZ = 0.01
"""Smallest cut-off, Hz: one unit on the wire. A smaller value would be rounded to 0, which disables the filter
instead of lowering its cut-off.
"""

UNFILTERED = "the gateway's filter is off (cut-off 0): every sample is as noisy as the sensor"
"""Notice of a client about a cut-off of 0, which may be intentional or a mistake."""


TESTED_PERIOD_MS = 1.0
"""Shortest stream period with which the firmware was tested, ms. Source: the firmware's own notes."""
HANGS = "it may have been stuck since its sensor was unplugged: plug the sensor in, then switch the gateway off and on"
"""Remedy for a gateway that does not respond: its program may be waiting for the sensor. Source: firmware."""


class GatewayState(IntEnum):
    """State of a gateway, in the first byte of an acknowledge."""

    READY = 0
    NOT_INITIALISED = 1
    """No sensor was detected at power-up: the gateway acknowledges commands but does not execute them."""


def payload_layout(name: str, size: int, *fields: Field) -> Layout:
    """Create the layout of a gateway's payload."""
    return Layout(name, size, "<", fields)


def axis_fields(axes: Sequence[str], like: Field) -> list[Field]:
    """Create consecutive two-byte fields, one for each axis. The first has the offset of `like`, and all have its
    other properties except the name.
    """
    return [replace(like, name=axis, offset=like.offset + 2 * place) for place, axis in enumerate(axes)]


STATE = Field("state", 0, "B", Mark.OBSERVED, "0 ready, 1 not initialised")
_CUTOFF = Field(
    "cutoff", 0, "H", Mark.OBSERVED, "cut-off of the first-order filter, 0 = unfiltered", 0.01, "Hz"
)


def counter_field(offset: int) -> Field:
    """Create the field of the counter that ends every sample."""
    return Field("counter", offset, "H", Mark.OBSERVED, "sensor samples since the start, modulo 65536")


EMPTY = payload_layout("no data", 0)
CUTOFF = payload_layout("cut-off", 2, _CUTOFF)
START = payload_layout(
    "asynchronous start", 6, _CUTOFF, Field("period", 2, "I", Mark.OBSERVED, "between frames", 1e-6, "s")
)
ACKNOWLEDGE = payload_layout("acknowledge", 1, STATE)


def read_start(payload: bytes) -> tuple[int, int]:
    """Decode the cut-off in units of 0.01 Hz and the period in µs as the firmware does: an incomplete value
    counts as 0.
    """
    size = 6 if len(payload) >= 6 else 2 if len(payload) >= 2 else 0
    raw = START.unpack(payload[:size].ljust(6, b"\0"))
    return int(raw["cutoff"]), int(raw["period"])


def first_order_delay(cutoff_hz: float) -> float:
    """Return the delay of a first-order low-pass filter, 1/(2π f_c), s; 0 for a cut-off of 0, which means
    unfiltered. Source: textbook delay at low frequencies.
    """
    return 1.0 / (2.0 * math.pi * cutoff_hz) if cutoff_hz else 0.0


def check_cutoff(cutoff_hz: float) -> None:
    """Raise ValueError if a cut-off cannot be sent to a gateway. 0 is allowed."""
    if not 0.0 <= cutoff_hz <= MAX_CUTOFF_HZ or 0.0 < cutoff_hz < SMALLEST_CUTOFF_HZ:
        raise SettingError(
            "cutoff_hz",
            f"must be {SMALLEST_CUTOFF_HZ} … {MAX_CUTOFF_HZ}, or 0 for unfiltered, got {cutoff_hz:g}",
        )


class SampleCounter:
    """Tracker of the sample counter across its wraps. It counts missing and repeated samples."""

    __slots__ = ("_last", "_sequence", "_statistics", "_step", "_straggler_from")

    def __init__(self, statistics: SensorStatistics, step: float, behind: int) -> None:
        """Create a tracker. `step` is the increment of the counter from frame to frame.

        A counter less than `behind` below the last one marks an old frame. A counter farther below is a large step
        forward.
        """
        self._statistics = statistics
        self._step = step
        self._straggler_from = COUNTER_MODULUS - behind
        self._last: int | None = None
        self._sequence: int | None = None

    def restart(self) -> None:
        """Continue after the device has restarted its counter: the sequence advances by 1."""
        self._last = None
        self._statistics.standing = 0

    def follow(self, counter: int) -> int | None:
        """Return the sequence number of the sample with this counter, or None for a repeated sample."""
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
