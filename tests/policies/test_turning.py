"""A policy that turns the tool: as fast as its action says, and never beyond the guard's limits of turning."""

import math
from itertools import pairwise
from typing import Any

import pytest
from msgspec.structs import replace

import hil_bridge
from hil_bridge.control.laws.policy import Axis
from hil_bridge.errors import Cause, ConfigError
from hil_bridge.gym import PolicyController, replay_policy
from hil_bridge.runs.simulation import Result
from protocol.geometry import angle_between, angle_of_vectors, inverse, product, rotation_vector, tool_axis
from tests.near_surface import CLOSE, STREAMED, merged

pytestmark = pytest.mark.sweep

AXES: tuple[Axis, ...] = ("along", "turn")


def tipping(share: float) -> Any:
    return lambda observation: [0.02 * float(observation[0]), share]


def run(robot: str, controller: Any, seconds: float = 2.0, **more: Any) -> Result:
    base = CLOSE if robot == "s3" else STREAMED
    sensor = "jr3" if robot == "s3" else "netft"
    settings = {"robot": {"emulated": robot}, "sensor": {"emulated": sensor}, "run": {"duration_s": seconds}}
    return hil_bridge.simulate(merged(merged(base, settings), more), controller=controller, seed=2)


def leaned_deg(result: Result) -> list[float]:
    """Angle of the ordered tool axis from that of the start, in each cycle with an order to turn, °."""
    home = tool_axis(result.cycles[0].sample.quaternion)
    ordered = [cycle.quaternion_commanded for cycle in result.cycles if cycle.quaternion_commanded]
    return [math.degrees(angle_of_vectors(home, tool_axis(one))) for one in ordered]


@pytest.mark.parametrize("robot", ["s3", "egm", "rsi", "rtde"])
@pytest.mark.parametrize("share", [1.0, -0.5])
def test_the_tool_tips_towards_the_travel_as_the_action_says(robot: str, share: float, tmp_path: Any) -> None:
    policy = PolicyController(tipping(share), AXES, turn_deg_s=4.0)
    result = run(robot, policy)
    assert result.outcome == "completed"
    assert result.retracted
    assert not any(cycle.verdict == "clamp" for cycle in result.cycles)
    tracked = [cycle for cycle in result.cycles if "action_turn" in cycle.explanation]
    seconds = tracked[-1].started_at - tracked[0].started_at
    expected = math.radians(4.0 * share * seconds)
    period = seconds / (len(tracked) - 1)
    home, ordered = result.cycles[0].sample.quaternion, tracked[-1].quaternion_commanded
    about = rotation_vector(product(ordered, inverse(home)))
    assert about == pytest.approx((expected, 0.0, 0.0), abs=math.radians(4.0) * 2.0 * period)
    assert about[1:] == pytest.approx((0.0, 0.0), abs=1e-9)  # about no other direction
    followed = rotation_vector(product(result.cycles[-1].sample.quaternion, inverse(home)))
    assert followed == pytest.approx(about, abs=math.radians(1.0))
    result.save(tmp_path / "run.mcap")
    assert not any(cycle.differences for cycle in replay_policy(tmp_path / "run.mcap", policy))


def test_no_action_turns_faster_or_farther_than_the_guard_allows() -> None:
    policy = PolicyController(tipping(1.0), AXES, turn_deg_s=1e6)
    limits = {"turn_deg_s": 8.0, "turn_total_deg": 12.0}
    result = run("egm", policy, 3.0, limits=limits)
    assert result.outcome == "completed"
    assert 11.9 < max(leaned_deg(result)) <= 12.0
    ordered = [(cycle.controlled_at, cycle.quaternion_commanded) for cycle in result.cycles]
    for (before, a), (after, b) in pairwise([one for one in ordered if one[1]]):
        assert math.degrees(angle_between(a, b)) <= 8.0 * (after - before) * 1.001 + 1e-6
    assert not any("turned faster" in "".join(cycle.reasons) for cycle in result.cycles)


def test_the_guard_judges_a_turn_that_the_program_did_not_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    """The last word is the guard's: a program that asks for more gets no more."""
    monkeypatch.setattr(
        "hil_bridge.control.steps.pressing.leaning", lambda leg, before, pressed, dt: before + 0.5
    )
    monkeypatch.setattr("hil_bridge.control.program.orienting.brought", lambda before, wanted, angle: wanted)
    result = run("egm", PolicyController(tipping(1.0), AXES), limits={"turn_total_deg": 12.0})
    assert max(leaned_deg(result), default=0.0) <= 12.0 + 1e-6
    reasons = {reason for cycle in result.cycles for reason in cycle.reasons}
    assert any("turned faster than 10" in reason or "tilted by more" in reason for reason in reasons)


@pytest.mark.parametrize("turn", [math.nan, math.inf])
def test_a_turn_that_is_no_number_is_a_controller_that_fails(turn: float) -> None:
    class Lost(PolicyController):
        def step(self, state: Any, measurement: Any, reference: float) -> Any:
            memory, command = super().step(state, measurement, reference)
            return memory, replace(command, turn=turn)

    result = run("egm", Lost(tipping(0.0), AXES))
    assert result.cause is Cause.CONTROLLER
    assert f"and a turn of {turn} rad" in result.text
    assert result.retracted


def test_without_the_axis_no_orientation_is_ordered() -> None:
    class Turning(PolicyController):
        def step(self, state: Any, measurement: Any, reference: float) -> Any:
            memory, command = super().step(state, measurement, reference)
            return memory, replace(command, turn=0.1)

    result = run("egm", Turning(lambda observation: [0.02 * float(observation[0])]))
    assert result.outcome == "completed"
    assert not any(cycle.quaternion_commanded for cycle in result.cycles)


def test_a_real_sensor_needs_the_mass_that_turns() -> None:
    """Its weight would pass for a force."""
    config = {"robot": {"emulated": "egm"}, "sensor": {"url": "netft+udp://127.0.0.1:49152"}}
    with pytest.raises(ConfigError, match='orientation = "led" turns the tool, and its weight with it'):
        hil_bridge.run_real(lambda: opened(config))


async def opened(config: Any) -> None:
    async with hil_bridge.simulation(config, controller=PolicyController(tipping(1.0), AXES)):
        raise AssertionError("the run was not refused")
