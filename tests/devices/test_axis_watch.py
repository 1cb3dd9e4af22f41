"""Dead axes, from values alone, of a sensor with counts and of one with SI units and no full scales."""

from random import Random

import pytest

from hil_bridge.devices.sensors.axis_watch import DEAD_AFTER_S, DEAD_WHILE_MOVED, AxisWatch
from protocol.devices.jr3 import facts_of
from protocol.wrench import SensorFacts

PERIOD_S = 0.01
ENOUGH = round(DEAD_AFTER_S / PERIOD_S) + 1
"""Number of frames until the time limit."""
QUIET = (0,) * 6
COUNTING = facts_of((115.0, 111.0, 185.0, 5.6, 5.2, 6.1), 0.01, 0.0)
PLAIN = SensorFacts("", (1.0,) * 6, None, None, 0.01, 0.0, "host")

FAR = {"counts": (COUNTING, 1, 16384 / 10), "SI": (PLAIN, 0.01, DEAD_WHILE_MOVED[1])}
"""Sensor, one step of its noise, and distance that fy must move while another axis is constant."""


@pytest.fixture(params=FAR, ids=list(FAR))
def kind(request):
    return FAR[request.param]


def watch(kind, frames, period=PERIOD_S):
    watched = AxisWatch(kind[0])
    for k, frame in enumerate(frames):
        watched.frame(frame, 700.0 + k * period)
    return watched


def moving(kind, dead=(), frames=2 * ENOUGH, reach=2.0):
    """Return frames: axes toggle about zero like a quiet sensor's, and fy moves far; those in `dead` stay at 0."""
    random = Random(3)
    _, noise, far = kind
    for k in range(frames):
        values = [-noise * (random.random() < 0.5) for _ in range(6)]
        values[1] += reach * far * (k + 1) / frames
        yield tuple(0 if axis in dead else value for axis, value in enumerate(values))


def test_axis_watch_finds_dead_axis_among_moving_ones(kind):
    assert watch(kind, moving(kind)).dead == ()
    assert watch(kind, moving(kind, dead={2})).dead == (2,)
    assert watch(kind, moving(kind, dead={2, 5})).dead == (2, 5)


def test_axis_watch_accepts_quiet_axes(kind):
    """An axis is not dead while nothing moves, soon after the zero, or if its value has changed before."""
    assert watch(kind, [QUIET] * 5000).dead == ()
    assert watch(kind, moving(kind, dead={2}, reach=0.99)).dead == ()
    assert watch(kind, moving(kind, dead={2}, frames=ENOUGH - 1)).dead == ()
    lived = [QUIET, (0, 0, -kind[1], 0, 0, 0), *moving(kind, dead={2})]
    assert watch(kind, lived).dead == ()


def test_axis_watch_restarts_after_zero(kind):
    watched = watch(kind, moving(kind, dead={2}))
    watched.zeroed()
    for k, values in enumerate(moving(kind)):
        watched.frame(values, 800.0 + k * PERIOD_S)
    assert watched.dead == ()


def test_axis_watch_time_limit_is_independent_of_rate(kind):
    """At 7 kHz, eight hundred frames last 0.11 s."""
    few = list(moving(kind, dead={2}))
    assert watch(kind, few, period=1 / 7000).dead == ()
    assert watch(kind, few, period=PERIOD_S).dead == (2,)
