"""The extremes of all frames between two decisions."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bridge.control import Peaks, Wrist

DOWN = (0.0, 1.0, 0.0, 0.0)
APPROACH = (0.0, 0.0, -1.0)
SCALES = (0.01, 0.01, 0.01, 0.001, 0.001, 0.001)
WRIST = Wrist(orientation=(0.8, 0.0, 0.6, 0.0), position=(0.01, 0.02, 0.03), flip=True)
FRAMES = st.lists(st.tuples(*[st.integers(-32768, 32767)] * 6), min_size=1, max_size=20)


def peaks(zero: tuple[float, ...] = (0.0,) * 6, wrist: Wrist = WRIST) -> Peaks:
    return Peaks(wrist.at_orientation(DOWN, DOWN, APPROACH), SCALES, zero)


@given(FRAMES)
def test_the_extremes_are_those_of_the_contact_wrenches(frames: list[tuple[int, ...]]) -> None:
    found, wrist = peaks(), WRIST.at_orientation(DOWN, DOWN, APPROACH)
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


def test_what_the_zero_took_off_counts_as_well() -> None:
    """40 N were taken for zero and 20 N came behind it: 60 N press."""
    found = peaks((0.0, 0.0, -40.0, 0.0, 0.0, 0.0), Wrist())
    found.frame((0, 0, -2000, 0, 0, 0))
    force, resultant, _, _ = found.take()
    assert force == pytest.approx(60.0), "the surface pushes the tool up"
    assert resultant == pytest.approx(60.0)


def test_a_saturated_frame_is_told_once() -> None:
    found = peaks()
    found.saturated = True
    assert found.take()[3]
    assert not found.take()[3]
