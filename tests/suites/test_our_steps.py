"""Our own steps pass the suite for steps of others."""

import pytest

from hil_bridge.control.steps.approach import Approach
from hil_bridge.control.steps.hold import Hold
from hil_bridge.control.steps.kinds import BUILT_IN
from hil_bridge.control.steps.move import Move
from hil_bridge.control.steps.paths import Line, Polyline
from hil_bridge.control.steps.retract import Retract
from hil_bridge.control.steps.seam import Criterion
from hil_bridge.control.steps.seek import Seek
from hil_bridge.control.steps.track import Track
from hil_bridge.control.steps.zero import Zero
from hil_bridge.testing.steps import *  # noqa: F403

CORNERS = Polyline(points_mm=((0.0, 0.0), (8.0, 0.0), (8.0, 4.0)))
STEPS = {
    "approach": Approach(name="touch", at_most_mm=12.0),
    "track": Track(path=Line(length_mm=10.0), for_s=6.0),
    "track, yielding": Track(path=CORNERS, across="compliant", lateral_limit_n=15.0, feed_error_n=4.0),
    "track, normal": Track(path=CORNERS, force_n=((0.0, 8.0), (12.0, 12.0)), orientation="normal"),
    "hold": Hold(for_s=3.0, name="place", criterion=Criterion(within_n=2.0)),
    "seek": Seek(direction_deg=30.0, at_most_mm=8.0),
    "seek, edge": Seek(direction_deg=0.0, until="edge", at_most_mm=8.0),
    "retract": Retract(back_mm=5.0),
    "move": Move(to_mm=(20.0, 10.0)),
    "zero": Zero(),
}


@pytest.fixture(params=list(STEPS.values()), ids=list(STEPS))
def step(request):
    return request.param


def test_each_built_in_word_is_tried():
    assert {step.do for step in STEPS.values()} == set(BUILT_IN)
