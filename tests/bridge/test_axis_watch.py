"""Near saturation, saturation behind a zero, and dead axes, from counts alone."""

from random import Random

import pytest

from hil_bridge.sensors.axis_watch import DEAD_AFTER_FRAMES, DEAD_WHILE_MOVED_COUNTS, AxisWatch

QUIET = (0,) * 6


def watch(frames, before=None):
    watched = AxisWatch()
    watched.zeroed(before)
    warnings = [text for frame in frames for text in watched.frame(frame)]
    return watched, warnings


def test_near_saturation_is_told_once_and_again_after_it_was_away():
    high, low = (0, 0, -27000, 0, 0, 0), (0, 0, -20000, 0, 0, 0)
    watched, warnings = watch([QUIET, high, high, (0, 0, -26000, 0, 0, 0), high])
    assert warnings == ["fz is at 82% of what the sensor can tell"]
    assert watched.saturated == ()
    assert len(watch([high, low, high])[1]) == 2


def sent(at_converter, offset):
    """What the device sends: the offset taken off behind the converter, the low 16 bits of what comes out."""
    return (at_converter - offset + 32768) % 65536 - 32768


@pytest.mark.parametrize("end", [32764, 32752, -32768])
@pytest.mark.parametrize("offset", [0, 5000, -5000])
def test_the_end_of_the_range_is_known_whatever_zero_was_taken(end, offset):
    watched, _ = watch([(sent(end, offset), 0, 0, 0, 0, 0)], before=(offset, 0, 0, 0, 0, 0))
    assert watched.saturated == ("fx",)
    inside = end * 0.8
    watched.frame((sent(int(inside), offset), 0, 0, 0, 0, 0))
    assert watched.saturated == ()


def test_counts_that_came_round_are_beyond_the_range():
    """At −30000 from a zero at 5000 the device sends 30536: a pull instead of a push."""
    assert sent(-30000, 5000) == 30536
    assert watch([(30536, 0, 0, 0, 0, 0)], before=(5000, 0, 0, 0, 0, 0))[0].saturated == ("fx",)


def test_a_second_zero_is_counted_from_the_first():
    watched, _ = watch([], before=(5000, 0, 0, 0, 0, 0))
    watched.zeroed((-2000, 0, 0, 0, 0, 0))
    watched.frame((32764 - 3000, 0, 0, 0, 0, 0))
    assert watched.saturated == ("fx",)


def moving(dead=(), frames=2 * DEAD_AFTER_FRAMES, reach=2 * DEAD_WHILE_MOVED_COUNTS):
    """All axes toggle about a zero as a quiet sensor does, and fy moves far; those in `dead` stay at 0."""
    random = Random(3)
    for k in range(frames):
        counts = [-(random.random() < 0.5) for _ in range(6)]
        counts[1] += reach * k // frames
        yield tuple(0 if axis in dead else count for axis, count in enumerate(counts))


def test_a_dead_axis_is_found_among_others_that_move():
    assert watch(moving())[0].dead == ()
    assert watch(moving(dead={2}))[0].dead == (2,)
    assert watch(moving(dead={2, 5}))[0].dead == (2, 5)


def test_quiet_axes_are_not_dead():
    """Neither while nothing moves, nor soon after the zero, nor when the axis lived once: it may rest at a count."""
    assert watch([QUIET] * 5000)[0].dead == ()
    assert watch(moving(dead={2}, reach=DEAD_WHILE_MOVED_COUNTS - 2))[0].dead == ()
    assert watch(moving(dead={2}, frames=DEAD_AFTER_FRAMES - 1))[0].dead == ()
    lived = [QUIET, (0, 0, -1, 0, 0, 0), *moving(dead={2})]
    assert watch(lived)[0].dead == ()


def test_a_zero_begins_anew():
    watched, _ = watch(moving(dead={2}))
    watched.zeroed(QUIET)
    for counts in moving():
        watched.frame(counts)
    assert watched.dead == ()
