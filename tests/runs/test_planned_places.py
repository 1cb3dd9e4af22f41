"""Places on the planned paths of a run, around which its page draws the work piece."""

import numpy as np
import pytest

from hil_bridge.api import load
from hil_bridge.runs.views import planned_places


def test_planned_places_of_plain_run_follow_travel() -> None:
    config = load({"run": {"duration_s": 10.0}, "task": {"speed_mm_s": 5.0}})
    (x, y, z), (u, v, w) = planned_places(config, ())
    assert (x, y, z) == pytest.approx((0.9, -0.1, 0.6))
    assert (u, v, w) == pytest.approx((0.9, -0.05, 0.6))


def test_planned_places_of_long_run_are_limited() -> None:
    places = np.array(planned_places(load({"run": {"duration_s": 3600.0}}), ()))
    assert np.ptp(places[:, 1]) == pytest.approx(0.3)
