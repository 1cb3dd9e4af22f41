"""Suite for every controller, and tests of the additional promises of this one."""

import pytest
from pi_controller.control import PiTracking

import hil_bridge
from hil_bridge.testing.controllers import *  # noqa: F403

DURATION_S = {"s3": 10.0, "egm": 1.0}
"""Duration of at least forty decisions after the force is reached, s."""


@pytest.fixture
def controller() -> PiTracking:
    return PiTracking()


@pytest.mark.parametrize("robot", ["s3", "egm"])
def test_it_comes_to_the_force_on_a_slow_robot_and_on_a_quick_one(robot: str) -> None:
    result = hil_bridge.simulate(
        {"robot": {"emulated": robot}, "run": {"duration_s": DURATION_S[robot]}}, controller="pi-tracking"
    )
    assert result.outcome == "completed"
    assert abs(result.figures.force_mean_steady_n - 10.0) < 0.5


def test_the_integral_does_not_wind_up() -> None:
    """Held back for a hundred samples, it recovers within three samples after the force is reached."""
    law, dt = PiTracking(), 0.18
    state, held = law.initial(), 0.01
    for number in range(100):
        state, command = law.step(state, hil_bridge.Measurement(number * dt, 2.0, held, held, dt=dt), 10.0)
        assert command.position > held
    steps = []
    for number in range(100, 103):
        state, command = law.step(state, hil_bridge.Measurement(number * dt, 12.0, held, held, dt=dt), 10.0)
        steps.append(command.correction)
    assert steps[-1] < 0.0
    without = PiTracking(tracking_time_s=1e6)
    state = without.initial()
    for number in range(100):
        state, _ = without.step(state, hil_bridge.Measurement(number * dt, 2.0, held, held, dt=dt), 10.0)
    _, command = without.step(state, hil_bridge.Measurement(100 * dt, 12.0, held, held, dt=dt), 10.0)
    assert command.correction > 0.0  # wound up: it pushes on, though the force is too much
