"""Built-in steps, tested by the suite for third-party steps."""

import math
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import pytest

from hil_bridge.control.course.intent import Phase
from hil_bridge.control.course.state import StepState
from hil_bridge.control.course.stroke import Order
from hil_bridge.control.steps.approach import Approach
from hil_bridge.control.steps.hold import Hold
from hil_bridge.control.steps.kinds import BUILT_IN
from hil_bridge.control.steps.led import Lead, LedStep, StepSample
from hil_bridge.control.steps.move import Move
from hil_bridge.control.steps.paths import Line, Polyline
from hil_bridge.control.steps.plan import StepPlan
from hil_bridge.control.steps.retract import Retract
from hil_bridge.control.steps.seam import NO_LIMITS, Criterion, Step, StepContext, StepLimits, StepResult
from hil_bridge.control.steps.seek import Seek
from hil_bridge.control.steps.track import Track
from hil_bridge.control.steps.zero import Zero
from hil_bridge.testing.steps import *  # noqa: F403
from hil_bridge.testing.steps import test_places_and_forces_stay_in_bounds as walk

CORNERS = Polyline(points_mm=((0.0, 0.0), (8.0, 0.0), (8.0, 4.0)))
STEPS = {
    "approach": Approach(name="touch", at_most_mm=12.0),
    "track": Track(path=Line(length_mm=10.0), for_s=6.0),
    "track, yielding": Track(path=CORNERS, across="compliant", lateral_limit_n=15.0, feed_error_n=4.0),
    "track, normal": Track(path=CORNERS, force_n=((0.0, 8.0), (12.0, 12.0)), orientation="normal"),
    "hold": Hold(for_s=3.0, name="place", criterion=Criterion(within_n=2.0)),
    "hold, sine": Hold(for_s=3.0, force_n=10.0, sine_n=2.0, sine_hz=1.0),
    "seek": Seek(direction_deg=30.0, at_most_mm=8.0),
    "seek, edge": Seek(direction_deg=0.0, until="edge", at_most_mm=8.0),
    "retract": Retract(back_mm=5.0),
    "move": Move(to_mm=(20.0, 10.0)),
    "zero": Zero(),
}


@pytest.fixture(params=list(STEPS.values()), ids=list(STEPS))
def step(request):
    return request.param


def test_built_in_steps_are_all_tested():
    assert {step.do for step in STEPS.values()} == set(BUILT_IN)


@dataclass(frozen=True, slots=True)
class Listening(LedStep):
    """Step that presses for two seconds, and stores the moments."""

    do: Literal["listening"] = "listening"
    for_s: float | None = 2.0
    limits: StepLimits = NO_LIMITS
    walks: ClassVar[list[list[tuple[float, ...]]]] = []

    def steer(self, memory: Any, sample: StepSample) -> tuple[Any, Lead]:
        if sample.s == 0.0:
            self.walks.append([])
        self.walks[-1].append(sample.moment)
        return memory, Lead((0.0, 0.0))


def test_step_suite_applies_moments_of_both_signs():
    """Walks start with both signs, and some keep it for several samples."""
    Listening.walks.clear()
    walk(Listening())
    for axis in range(3):
        moments = [[each[axis] for each in walk if not math.isnan(each[axis])] for walk in Listening.walks]
        signs = [[(value > 0.0) - (value < 0.0) for value in values if value] for values in moments]
        assert all({-1, 1} == set(values) for values in signs)
        assert {values[0] for values in signs if values[0] == values[1]} == {-1, 1}
        assert any(0.0 in values for values in moments)
        assert all(abs(value) < 5.0 for values in moments for value in values)


@dataclass(frozen=True, slots=True)
class Deepens(Step):
    """Faulty step that presses, but declares it a retraction."""

    do: Literal["deepens"] = "deepens"
    for_s: float | None = 1.0

    def seconds(self, plan: StepPlan, begin: object) -> float:
        return 1.0

    def take(self, context: StepContext, state: StepState) -> StepResult:
        return StepResult(state, Order(Phase.RETRACT, context.contact.measurement.commanded + 1e-6))


def test_retraction_going_deeper_is_detected():
    with pytest.raises(
        AssertionError, match=r"it declares an order a retraction that moves 0\.001 mm deeper"
    ):
        walk(Deepens())
