"""Policy that rotates the tool at the speed of its action, within the guard's rotation limits."""

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
    """Return the angle of the ordered tool axis from its start in each cycle with an order to rotate, °."""
    home = tool_axis(result.cycles[0].sample.quaternion)
    ordered = [cycle.quaternion_commanded for cycle in result.cycles if cycle.quaternion_commanded]
    return [math.degrees(angle_of_vectors(home, tool_axis(one))) for one in ordered]


@pytest.mark.parametrize("robot", ["s3", "egm", "rsi", "rtde"])
@pytest.mark.parametrize("share", [1.0, -0.5])
def test_tilt_action_tilts_tool_towards_travel(robot: str, share: float, tmp_path: Any) -> None:
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


def test_rotation_is_limited_by_guard() -> None:
    policy = PolicyController(tipping(1.0), AXES, turn_deg_s=1e6)
    limits = {"turn_deg_s": 8.0, "turn_total_deg": 12.0}
    result = run("egm", policy, 3.0, limits=limits)
    assert result.outcome == "completed"
    assert 11.9 < max(leaned_deg(result)) <= 12.0
    ordered = [(cycle.controlled_at, cycle.quaternion_commanded) for cycle in result.cycles]
    for (before, a), (after, b) in pairwise([one for one in ordered if one[1]]):
        assert math.degrees(angle_between(a, b)) <= 8.0 * (after - before) * 1.001 + 1e-6
    assert not any("turned faster" in "".join(cycle.reasons) for cycle in result.cycles)


def test_guard_limits_rotation_unbounded_by_program(monkeypatch: pytest.MonkeyPatch) -> None:
    """The guard decides last: a program that requests more does not get more."""
    monkeypatch.setattr(
        "hil_bridge.control.steps.pressing.leaning", lambda leg, before, pressed, dt: before + 0.5
    )
    monkeypatch.setattr(
        "hil_bridge.control.program.orienting.rotate_towards", lambda before, requested, angle: requested
    )
    result = run("egm", PolicyController(tipping(1.0), AXES), limits={"turn_total_deg": 12.0})
    assert max(leaned_deg(result), default=0.0) <= 12.0 + 1e-6
    reasons = {reason for cycle in result.cycles for reason in cycle.reasons}
    assert any("turned faster than 10" in reason or "tilted by more" in reason for reason in reasons)


@pytest.mark.parametrize("turn", [math.nan, math.inf])
def test_non_numeric_rotation_fails_controller(turn: float) -> None:
    class Lost(PolicyController):
        def step(self, state: Any, measurement: Any, reference: float) -> Any:
            memory, command = super().step(state, measurement, reference)
            return memory, replace(command, turn=turn)

    result = run("egm", Lost(tipping(0.0), AXES))
    assert result.cause is Cause.CONTROLLER
    assert f"and a turn of {turn} rad" in result.text
    assert result.retracted


def test_orientation_without_axis_is_not_ordered() -> None:
    class Turning(PolicyController):
        def step(self, state: Any, measurement: Any, reference: float) -> Any:
            memory, command = super().step(state, measurement, reference)
            return memory, replace(command, turn=0.1)

    result = run("egm", Turning(lambda observation: [0.02 * float(observation[0])]))
    assert result.outcome == "completed"
    assert not any(cycle.quaternion_commanded for cycle in result.cycles)


def test_rotating_tool_with_real_sensor_needs_its_mass() -> None:
    """Without it, the weight of the tool would be read as a contact force."""
    config = {"robot": {"emulated": "egm"}, "sensor": {"url": "netft+udp://127.0.0.1:49152"}}
    with pytest.raises(ConfigError, match='orientation = "led" turns the tool, and its weight with it'):
        hil_bridge.run_real(lambda: opened(config))


async def opened(config: Any) -> None:
    async with hil_bridge.simulation(config, controller=PolicyController(tipping(1.0), AXES)):
        raise AssertionError("the run was not refused")
