"""The extremes of all frames between two decisions."""

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
"""With a bias and a tool below it, of which no zero was taken: they count in each frame."""
TILTED = (0.1, 0.9, 0.3, 0.3)
FRAMES = st.lists(st.tuples(*[st.integers(-32768, 32767)] * 6), min_size=1, max_size=20)


def peaks() -> Peaks:
    return Peaks(WRIST.at_orientation(TILTED, None, APPROACH), SCALES)


@given(FRAMES)
def test_the_extremes_are_those_of_the_contact_wrenches(frames: list[tuple[int, ...]]) -> None:
    found, wrist = peaks(), WRIST.at_orientation(TILTED, None, APPROACH)
    wrenches = []
    for frame in frames:
        found.frame(frame)
        wrenches.append(
            wrist.contact_wrench([count * scale for count, scale in zip(frame, SCALES, strict=True)])
        )
    force, resultant, moment, saturated = found.take()
    along = [wrist.force_along(0, wrench) for wrench in wrenches]
    assert abs(force) == pytest.approx(max(map(abs, along)))
    assert resultant == pytest.approx(max(sum(v * v for v in wrench[:3]) ** 0.5 for wrench in wrenches))
    assert moment == pytest.approx(max(sum(v * v for v in wrench[3:]) ** 0.5 for wrench in wrenches))
    assert saturated is False
    assert found.take() == (0.0, 0.0, 0.0, False), "each frame counts once"
    assert found.resultant(frames[0]) == pytest.approx(sum(v * v for v in wrenches[0][:3]) ** 0.5)
    assert found.along(frames[0]) == pytest.approx(along[0])


def test_what_the_zero_took_off_counts_as_well() -> None:
    """40 N were taken for zero and 20 N came behind it: 60 N press."""
    down = Wrist().at_orientation((0.0, 1.0, 0.0, 0.0), None, APPROACH)
    found = Peaks(down, SCALES, (0.0, 0.0, -40.0, 0.0, 0.0, 0.0))
    found.frame((0, 0, -2000, 0, 0, 0))
    force, resultant, _, _ = found.take()
    assert force == pytest.approx(60.0), "the surface pushes the tool up"
    assert resultant == pytest.approx(60.0)


def test_a_zero_in_any_direction_hides_no_force() -> None:
    wrist = WRIST.at_orientation(TILTED, None, APPROACH)
    taken = (30.0, -40.0, -20.0, 0.0, 0.0, 0.0)
    found, frame = Peaks(wrist, SCALES, taken), (-200, 100, -300, 4, 5, 6)
    wrench = wrist.contact_wrench([count * scale for count, scale in zip(frame, SCALES, strict=True)])
    beside = [value + zero for value, zero in zip(wrench, taken, strict=True)]
    found.frame(frame)
    force, resultant, _, _ = found.take()
    both = wrist.force_along(0, wrench), wrist.force_along(0, beside)
    assert force == pytest.approx(max(both, key=abs))
    assert resultant == pytest.approx(max(math.hypot(*wrench[:3]), math.hypot(*beside[:3])))


def test_from_a_programs_own_zero_its_wrench_is_taken_off() -> None:
    wrist = WRIST.at_orientation(TILTED, None, APPROACH)
    found, frame, own = peaks(), (-200, 100, -300, 4, 5, 6), (3.0, -4.0, -2.0, 0.1, 0.2, 0.3)
    found.rezero(own)
    wrench = wrist.contact_wrench([count * scale for count, scale in zip(frame, SCALES, strict=True)])
    left = [value - zero for value, zero in zip(wrench, own, strict=True)]
    assert found.resultant(frame) == pytest.approx(math.hypot(*left[:3]))
    assert found.along(frame) == pytest.approx(wrist.force_along(0, left))


def test_zero_of_a_program_hides_no_peak() -> None:
    """60 N press, 15 N of them since the zero that the program took: the peaks stay those of the run's zero."""
    down = Wrist().at_orientation((0.0, 1.0, 0.0, 0.0), None, APPROACH)
    found = Peaks(down, SCALES)
    found.rezero((0.0, 0.0, -45.0, 0.0, 0.0, 0.0))
    found.frame((0, 0, -6000, 0, 0, 0))
    assert found.take()[:2] == pytest.approx((60.0, 60.0))
    assert found.along((0, 0, -6000, 0, 0, 0)) == pytest.approx(15.0)


def test_a_saturated_frame_is_told_once() -> None:
    found = peaks()
    found.saturated = True
    assert found.take()[3]
    assert not found.take()[3]
