"""Properties common to all sensors: their facts, the wrench of a frame, and a host zero."""

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.wrench import HostTare, SensorFacts, wrench_of

SIX = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
FACTS = SensorFacts("", SIX, None, None, None, 0.0, "host")


def test_values_times_scales_are_newtons() -> None:
    assert wrench_of((2, 0, -1, 1, 0, 10), (0.5, 1.0, 0.25, 0.1, 1.0, 0.01)) == (
        1.0,
        0.0,
        -0.25,
        0.1,
        0.0,
        0.1,
    )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"scales": SIX[:5]}, "scales of a sensor must be six numbers above 0"),
        ({"scales": (*SIX[:5], 0.0)}, "scales of a sensor must be six numbers above 0"),
        ({"full_scales": (*SIX[:5], float("inf"))}, "full_scales of a sensor must be six numbers above 0"),
        ({"range": (*SIX[:5], float("nan"))}, "range of a sensor must be six numbers above 0"),
        ({"period": 0.0}, "period of a sensor must be above 0 s and at most 10 s, got 0"),
        ({"period": 1000.0}, "period of a sensor must be above 0 s and at most 10 s, got 1000"),
        ({"delay": -0.5}, "delay of a sensor must be 0 … 20 s, got -0.5"),
        ({"delay": 1e308}, "delay of a sensor must be 0 … 20 s, got 1e"),
        ({"tares": "robot"}, "tares of a sensor must be device or host, got 'robot'"),
    ],
)
def test_invalid_facts_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        replace(FACTS, **changes)


def test_host_zero_is_the_mean_of_the_samples_after_the_request() -> None:
    tare = HostTare(samples=2)
    assert (tare.values(SIX), tare.took) == (SIX, False)
    tare.zero()
    assert (tare.values((1.0,) * 6), tare.took) == ((1.0,) * 6, False)
    assert (tare.values((3.0,) * 6), tare.took) == ((3.0,) * 6, True)  # told from the zero before
    assert (tare.values(SIX), tare.took) == ((-1.0, 0.0, 1.0, 2.0, 3.0, 4.0), False)


def test_second_host_zero_replaces_the_first() -> None:
    tare = HostTare()
    for raw in (2.0, 5.0):
        tare.zero()
        tare.values((raw,) * 6)
        assert tare.took
    assert tare.values((6.0,) * 6) == (1.0,) * 6


def test_host_zero_requested_again_restarts() -> None:
    tare = HostTare(samples=2)
    tare.zero()
    tare.values((100.0,) * 6)
    tare.zero()
    for _ in range(2):
        tare.values((4.0,) * 6)
    assert tare.values((4.0,) * 6) == (0.0,) * 6


@given(st.lists(st.tuples(*[st.integers(-1000, 1000)] * 6), min_size=1, max_size=5))
def test_samples_of_a_host_zero_average_to_0(samples: list[tuple[int, ...]]) -> None:
    tare = HostTare(len(samples))
    tare.zero()
    for raw in samples:
        tare.values(raw)
    after = [tare.values(raw) for raw in samples]
    for axis in zip(*after, strict=True):
        assert sum(axis) == pytest.approx(0.0, abs=1e-9)


def test_host_zero_needs_a_sample() -> None:
    with pytest.raises(ValueError, match="a zero needs at least 1 sample, got 0"):
        HostTare(0)
