"""Saturation of a JR3 sensor relative to a zero, from counts alone."""

from collections.abc import Iterable

import pytest

from protocol.devices.jr3.range import Range
from protocol.wrench import AXES

Counts = tuple[int, ...]

QUIET = (0,) * 6


def watch(frames: Iterable[Counts], before: Counts | None = None) -> tuple[Range, tuple[str, ...], list[str]]:
    """Return the range after some frames, the axes saturated in the last one, and all warnings."""
    watched, bits, warnings = Range(), 0, []
    watched.zeroed(before)
    for frame in frames:
        bits = watched.saturated(frame)
        warnings += watched.warnings
    return watched, axes(bits), warnings


def axes(bits: int) -> tuple[str, ...]:
    return tuple(axis for k, axis in enumerate(AXES) if bits >> k & 1)


def test_near_saturation_is_reported_once_and_after_a_pause() -> None:
    high, low = (0, 0, -27000, 0, 0, 0), (0, 0, -20000, 0, 0, 0)
    _, saturated, warnings = watch([QUIET, high, high, (0, 0, -26000, 0, 0, 0), high])
    assert warnings == ["fz is at 82% of the sensor's range"]
    assert saturated == ()
    assert len(watch([high, low, high])[2]) == 2
    assert len(watch([high, QUIET, QUIET, QUIET])[2]) == 1


def sent_value(at_converter: int, offset: int) -> int:
    """Output of the device: the offset subtracted after the converter, the low 16 bits of the result."""
    return (at_converter - offset + 32768) % 65536 - 32768


@pytest.mark.parametrize("end", [32764, 32752, -32768])
@pytest.mark.parametrize("offset", [0, 5000, -5000])
def test_end_of_range_is_known_for_any_zero(end: int, offset: int) -> None:
    watched, saturated, _ = watch([(sent_value(end, offset), 0, 0, 0, 0, 0)], before=(offset, 0, 0, 0, 0, 0))
    assert saturated == ("fx",)
    inside = end * 0.8
    assert watched.saturated((sent_value(int(inside), offset), 0, 0, 0, 0, 0)) == 0


def test_every_axis_has_its_bit() -> None:
    assert watch([(32767, 0, -32768, 0, 0, 32760)])[1] == ("fx", "fz", "mz")


def test_counts_that_wrapped_are_out_of_range() -> None:
    """At −30000 from a zero at 5000 the device sends 30536: a pull instead of a push."""
    assert sent_value(-30000, 5000) == 30536
    assert watch([(30536, 0, 0, 0, 0, 0)], before=(5000, 0, 0, 0, 0, 0))[1] == ("fx",)


def test_second_zero_is_counted_from_the_first() -> None:
    watched, _, _ = watch([], before=(5000, 0, 0, 0, 0, 0))
    watched.zeroed((-2000, 0, 0, 0, 0, 0))
    assert axes(watched.saturated((32764 - 3000, 0, 0, 0, 0, 0))) == ("fx",)


def test_restarted_device_has_no_zero() -> None:
    watched, _, _ = watch([(32764 - 5000, 0, 0, 0, 0, 0)], before=(5000, 0, 0, 0, 0, 0))
    watched.restart()
    assert (watched.newest, watched.warnings) == (None, [])
    assert watched.saturated((30536, 0, 0, 0, 0, 0)) == 0
