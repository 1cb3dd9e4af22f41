"""Extremes of all frames between two decisions."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bridge.control import Peaks, Wrist

APPROACH = (0.0, 0.0, -1.0)
SCALES = (0.01, 0.01, 0.01, 0.001, 0.001, 0.001)
WRIST = Wrist(
    (0.8, 0.0, 0.6, 0.0), (0.01, 0.02, 0.03), True, (1.0, -2.0, 3.0, 0.1, 0.2, -0.3), 0.5, (0.02, 0.03, 0.08)
)
"""Sensor with a bias and the weight of a tool, neither removed by a zero, so both appear in every frame."""
TILTED = (0.1, 0.9, 0.3, 0.3)
FRAMES = st.lists(st.tuples(*[st.integers(-32768, 32767)] * 6), min_size=1, max_size=20)


def peaks() -> Peaks:
    return Peaks(WRIST.at_orientation(TILTED, None, APPROACH), SCALES)


@given(FRAMES)
def test_peaks_match_contact_wrenches(frames: list[tuple[int, ...]]) -> None:
    peaks_, wrist = peaks(), WRIST.at_orientation(TILTED, None, APPROACH)
    wrenches = []
    for frame in frames:
        peaks_.frame(frame)
        wrenches.append(
            wrist.contact_wrench([count * scale for count, scale in zip(frame, SCALES, strict=True)])
        )
    force, resultant, moment, saturated = peaks_.take()
    along = [wrist.force_along(0, wrench) for wrench in wrenches]
    assert abs(force) == pytest.approx(max(map(abs, along)))
    assert resultant == pytest.approx(max(sum(v * v for v in wrench[:3]) ** 0.5 for wrench in wrenches))
    assert moment == pytest.approx(max(sum(v * v for v in wrench[3:]) ** 0.5 for wrench in wrenches))
    assert saturated is False
    assert peaks_.take() == (0.0, 0.0, 0.0, False), "each frame counts once"
    assert peaks_.resultant(frames[0]) == pytest.approx(sum(v * v for v in wrenches[0][:3]) ** 0.5)
    assert peaks_.along(frames[0]) == pytest.approx(along[0])


def test_peaks_include_force_removed_by_zero() -> None:
    """40 N were used as the zero, and 20 N were added later: 60 N press."""
    down = Wrist().at_orientation((0.0, 1.0, 0.0, 0.0), None, APPROACH)
    peaks_ = Peaks(down, SCALES, (0.0, 0.0, -40.0, 0.0, 0.0, 0.0))
    peaks_.frame((0, 0, -2000, 0, 0, 0))
    force, resultant, _, _ = peaks_.take()
    assert force == pytest.approx(60.0), "the surface pushes the tool up"
    assert resultant == pytest.approx(60.0)


def test_peaks_with_zero_in_any_direction_hide_no_force() -> None:
    wrist = WRIST.at_orientation(TILTED, None, APPROACH)
    zeros = (30.0, -40.0, -20.0, 0.0, 0.0, 0.0)
    peaks_, frame = Peaks(wrist, SCALES, zeros), (-200, 100, -300, 4, 5, 6)
    wrench = wrist.contact_wrench([count * scale for count, scale in zip(frame, SCALES, strict=True)])
    shifted = [value + zero for value, zero in zip(wrench, zeros, strict=True)]
    peaks_.frame(frame)
    force, resultant, _, _ = peaks_.take()
    both = wrist.force_along(0, wrench), wrist.force_along(0, shifted)
    assert force == pytest.approx(max(both, key=abs))
    assert resultant == pytest.approx(max(math.hypot(*wrench[:3]), math.hypot(*shifted[:3])))


def test_peaks_subtract_program_zero() -> None:
    wrist = WRIST.at_orientation(TILTED, None, APPROACH)
    peaks_, frame, own = peaks(), (-200, 100, -300, 4, 5, 6), (3.0, -4.0, -2.0, 0.1, 0.2, 0.3)
    peaks_.rezero(own)
    wrench = wrist.contact_wrench([count * scale for count, scale in zip(frame, SCALES, strict=True)])
    left = [value - zero for value, zero in zip(wrench, own, strict=True)]
    assert peaks_.resultant(frame) == pytest.approx(math.hypot(*left[:3]))
    assert peaks_.along(frame) == pytest.approx(wrist.force_along(0, left))


def test_peaks_with_program_zero_hide_no_force() -> None:
    """The contact force is 60 N, of which 15 N came after the program's zero; the peaks refer to the run's zero."""
    down = Wrist().at_orientation((0.0, 1.0, 0.0, 0.0), None, APPROACH)
    peaks_ = Peaks(down, SCALES)
    peaks_.rezero((0.0, 0.0, -45.0, 0.0, 0.0, 0.0))
    peaks_.frame((0, 0, -6000, 0, 0, 0))
    assert peaks_.take()[:2] == pytest.approx((60.0, 60.0))
    assert peaks_.along((0, 0, -6000, 0, 0, 0)) == pytest.approx(15.0)


def test_peaks_report_saturation_once() -> None:
    peaks_ = peaks()
    peaks_.saturated = True
    assert peaks_.take()[3]
    assert not peaks_.take()[3]
