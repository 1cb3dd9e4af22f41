"""Tests of a recording of the emulated Universal Robot by the analysis that gave the figures of real ones.

The figures come from third-party recordings; `emulators.devices.rtde.generations` names them. White noise is the
standard deviation of the differences of successive samples, divided by √2.
"""

import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from emulators.devices.rtde import RtdeProfile, RtdeRobot
from emulators.devices.rtde.arm import Servo
from emulators.devices.rtde.controller import Controller
from emulators.devices.rtde.state import getter
from emulators.seams import StartPose
from protocol.devices.rtde.rotation import pose_of
from protocol.devices.rtde.wires import Port

pytestmark = pytest.mark.sweep

Floats = NDArray[np.float64]

T0 = 1000.25
START = StartPose((0.4, -0.1, 0.4), (0.05, 0.7, 0.7, 0.05), 0.1)
"""Tool down, turned; closer to a half turn about one axis, the two others of the rotation vector are noisier."""
STEP_RAD = 2.0 * math.pi / 2**19
SETTLED_S = 0.5
"""Time by which a motion has begun, and its filter has settled."""

SERVO = """
def wave():
  q = get_target_joint_positions()
  t = 0
  while True:
    s = 0.02 * sin(2 * 3.14159265 * t / 3)
    servoj([q[0]+s, q[1]+s, q[2]-s, q[3]+s, q[4]-s, q[5]+s], t=0.002, lookahead_time=0.03, gain=1000)
    t = t + 0.002
  end
end
"""
SPEED = """
def wave():
  t = 0
  while True:
    s = 1.2 * sin(2 * 3.14159265 * t / 3)
    speedj([s, s, -s, s, -s, s], a=20, t=0.002)
    t = t + 0.002
  end
end
"""


class Recording(NamedTuple):
    """Outputs of one robot, cycle by cycle."""

    period: float
    outputs: dict[str, Floats]
    """Outputs by name, (n, axes)."""
    arguments: Floats
    """Joints requested by the program, (n, 6)."""

    def white(self, name: str) -> list[float]:
        """Return the white noise of each axis of an output."""
        noise: list[float] = (np.diff(self.outputs[name], axis=0).std(axis=0) / math.sqrt(2.0)).tolist()
        return noise

    def moving(self) -> "Recording":
        """Return the part in which the motion has settled."""
        begin = round(SETTLED_S / self.period)
        outputs = {name: values[begin:] for name, values in self.outputs.items()}
        return Recording(self.period, outputs, self.arguments[begin:])


NAMES = (
    *("actual_q", "actual_qd", "target_q", "target_qd", "target_qdd", "actual_current"),
    *("actual_TCP_pose", "actual_TCP_speed", "actual_TCP_force", "target_TCP_pose", "target_TCP_speed"),
    "actual_tool_accelerometer",
)


@cache
def record(model: str, seconds: float, program: str = "", seed: int = 7) -> Recording:
    """Return outputs of a robot with its default settings."""
    robot = RtdeRobot(RtdeProfile(model=model), START, T0, seed)  # type: ignore[arg-type]
    controller, now = robot.controller, T0
    if program:
        port = robot.connect(Port.SCRIPT, now)
        assert port is not None
        port.receive(program.encode(), now)
    rows: dict[str, list[Sequence[float]]] = {name: [] for name in NAMES}
    arguments = []
    for _ in range(round(seconds / controller.period)):
        now += controller.period
        controller.advance(now)
        for name, values in rows.items():
            values.append(getter(name)(controller.snapshots[-1]))
        arguments.append(controller.arm.target)
    assert not controller.counts, "nothing has stopped it"
    outputs = {name: np.array(values) for name, values in rows.items()}
    return Recording(controller.period, outputs, np.array(arguments))


def lag(target: Floats, actual: Floats, period: float) -> tuple[float, float]:
    """Return the delay of one signal behind the other, s, by the best shift, and the remaining difference, root mean
    square.
    """
    times, edge = np.arange(len(target)) * period, round(0.1 / period)
    part = slice(edge, -edge)
    shifts = np.arange(-0.01, 0.06, 0.00025)
    rests = [(actual[part] - np.interp(times[part] - shift, times, target)).std() for shift in shifts]
    best = int(np.argmin(rests))
    return float(shifts[best]), float(rests[best])


def within(values: Sequence[float], lowest: float, highest: float, slack: float = 0.05) -> bool:
    """Return whether all values lie in a range of recorded ones, with a tolerance for the length of ours."""
    return all(lowest * (1.0 - slack) <= value <= highest * (1.0 + slack) for value in values)


def test_stationary_joints_have_real_noise_and_steps() -> None:
    rest = record("ur5e", 4.0)
    assert within(rest.white("actual_q"), 15e-6, 24e-6)
    steps = rest.outputs["actual_q"] / STEP_RAD
    assert np.abs(steps - steps.round()).max() < 1e-6
    assert np.unique(np.abs(np.diff(steps.round(), axis=0)))[1] == 1.0
    correlation = [np.corrcoef(joint[1:], joint[:-1])[0, 1] for joint in rest.outputs["actual_q"].T]
    assert max(map(abs, correlation)) < 0.1, "white"
    assert not rest.outputs["actual_qd"].any(), "exactly 0, although the joints are noisy"
    assert not rest.outputs["actual_TCP_speed"].any()


def test_stationary_pose_matches_reported_joints() -> None:
    rest = record("ur5e", 4.0)
    noise = rest.white("actual_TCP_pose")
    assert within(noise[:3], 5e-6, 15e-6)
    assert within(noise[3:], 23e-6, 50e-6)
    controller = RtdeRobot(RtdeProfile(model="ur5e"), START, T0, 7).controller
    for joints, reported in zip(
        rest.outputs["actual_q"][:5], rest.outputs["actual_TCP_pose"][:5], strict=True
    ):
        a, b, c, d, e, f = joints.tolist()
        pose = controller.manipulator.forward((a, b, c, d, e, f))
        assert pose.position == pytest.approx(pose_of(reported.tolist()).position, abs=1e-12)


def test_stationary_force_and_current_have_real_noise() -> None:
    rest = record("ur5e", 4.0)
    force = rest.white("actual_TCP_force")
    ranges = ((0.17, 0.20), (0.13, 0.18), (0.10, 0.12))
    assert all(within([part], *each) for part, each in zip(force[:3], ranges, strict=True))
    assert force[3:] == pytest.approx((0.0045, 0.0048, 0.0035), rel=0.1)
    assert rest.white("actual_current") == pytest.approx((0.06, 0.06, 0.064, 0.014, 0.007, 0.023), rel=0.1)
    assert rest.white("actual_tool_accelerometer") == pytest.approx((0.17, 0.12, 0.12), rel=0.1)
    assert np.abs(rest.outputs["actual_TCP_force"].mean(axis=0)).max() < 4.6


def test_cb3_noise_matches_recording() -> None:
    rest = record("ur5", 4.0)
    force = rest.white("actual_TCP_force")
    assert within(force[:3], 0.24, 1.15)
    assert within(force[3:], 0.03, 0.16)
    assert within(rest.white("actual_TCP_pose")[3:], 15e-6, 50e-6)
    steps = rest.outputs["actual_q"] / STEP_RAD
    assert np.abs(steps - steps.round()).max() > 0.3, "its grid is not known, and it has none"


@pytest.mark.parametrize("seed", [7, 8])
def test_slow_joint_follow_error_matches_recording(seed: int) -> None:
    """A UR5e at up to 42 mrad/s: -3.0 to 5.5 ms behind, 60 to 120 µrad off, at most 336."""
    slow = record("ur5e", 8.0, SERVO, seed).moving()
    targets, actual = slow.outputs["target_q"], slow.outputs["actual_q"]
    pairs = [lag(to, at, slow.period) for to, at in zip(targets.T, actual.T, strict=True)]
    assert all(-0.003 <= late <= 0.0055 for late, _ in pairs)
    assert 60e-6 < np.mean([rest for _, rest in pairs]) < 120e-6
    assert np.abs(actual[1:] - targets[:-1]).max() < 500e-6
    assert within((slow.outputs["actual_qd"] - slow.outputs["target_qd"]).std(axis=0), 1.3e-3, 2.4e-3)
    off = slow.outputs["actual_TCP_pose"][1:, :3] - slow.outputs["target_TCP_pose"][:-1, :3]
    assert 0.03e-3 < off.std(axis=0).mean() < 0.08e-3, "0.04 to 0.06 mm of the tool"
    force = slow.white("actual_TCP_force")
    assert force == pytest.approx((0.34, 0.20, 0.13, 0.007, 0.015, 0.011), rel=0.1)


def test_fast_joint_follow_error_is_larger() -> None:
    """A UR10e under speedj at up to 1.7 rad/s: 0.1 mrad, and 0.2 to 0.7 mrad for most joints."""
    fast = record("ur5e", 8.0, SPEED).moving()
    targets, actual = fast.outputs["target_q"], fast.outputs["actual_q"]
    pairs = [lag(to, at, fast.period) for to, at in zip(targets.T, actual.T, strict=True)]
    assert all(-0.0018 <= late <= 0.004 for late, _ in pairs)
    assert within([rest for _, rest in pairs], 0.2e-3, 0.7e-3)


def test_follow_error_changes_slowly() -> None:
    """Recorded: correlated by 0.95 to 0.83 after 10 ms, by 0.63 to 0.32 after 50, by 0.1 after 100."""
    slow = record("ur5e", 8.0, SERVO).moving()
    off = slow.outputs["actual_q"][1:] - slow.outputs["target_q"][:-1]

    def correlation(cycles: int) -> float:
        return float(np.mean([np.corrcoef(one[cycles:], one[:-cycles])[0, 1] for one in off.T]))

    assert 0.8 < correlation(5) < 0.97
    assert 0.3 < correlation(25) < 0.8
    assert abs(correlation(50)) < 0.35
    assert within(slow.white("actual_qd"), 0.76e-3, 1.42e-3)


def test_braked_joint_does_not_reach_target() -> None:
    """Before its motion the recorded UR5e stood within 40 µrad of its targets, with the noise of its encoders."""
    stopped, braked = (
        RtdeRobot(RtdeProfile(model="ur5e"), START, T0, 7).controller for _ in ("stands", "held")
    )
    for controller in (stopped, braked):
        controller.start_program(lambda controller=controller: Wave(controller))  # type: ignore[misc]
        controller.advance(T0 + 2.0)
    stopped.player.stop(stopped.now)
    braked.power_off()
    for controller in (stopped, braked):
        controller.advance(T0 + 4.0)
    apart = [
        math.dist(
            controller.path.pose.position, controller.manipulator.forward(controller.arm.joints).position
        )
        for controller in (stopped, braked)
    ]
    assert apart[0] < 1e-9
    assert apart[1] > 1e-6
    place = braked.path.pose
    braked.advance(T0 + 5.0)
    assert braked.path.pose == place


class Wave:
    """Program that makes the joints oscillate."""

    name = "wave"

    def __init__(self, controller: Controller) -> None:
        self._controller, self._start, self._cycle = controller, controller.arm.joints, 0

    def cycle(self) -> bool:
        self._cycle += 1
        offset = 0.02 * math.sin(2.0 * math.pi * self._cycle * self._controller.period / 3.0)
        a, b, c, d, e, f = (joint + offset for joint in self._start)
        self._controller.order(Servo((a, b, c, d, e, f), 0.03, 1000.0, 1))
        return True

    def close(self) -> None:
        """Do nothing: there is nothing to close."""


def test_servoj_delay_matches_recording() -> None:
    """34 ms of a UR10e with a look-ahead of 30 ms, of which 4 to 6 ms are the link and the program."""
    slow = record("ur5e", 8.0, SERVO).moving()
    argument, actual = slow.arguments[:, 0], slow.outputs["actual_q"][:, 0]
    late, _ = lag(argument, actual, slow.period)
    assert late == pytest.approx(0.030, abs=0.003)
    to_target, _ = lag(argument, slow.outputs["target_q"][:, 0], slow.period)
    assert to_target == pytest.approx(0.028, abs=0.003), (
        "the filter alone; the target is what comes out of it"
    )


@pytest.mark.parametrize(
    ("value", "rate"), [("target_q", "target_qd"), ("target_qd", "target_qdd")], ids=["speed", "acceleration"]
)
def test_targets_are_consistent(value: str, rate: str) -> None:
    slow = record("ur5e", 8.0, SERVO).moving()
    changes = np.diff(slow.outputs[value], axis=0) / slow.period
    assert np.abs(changes - slow.outputs[rate][1:]).max() < 1e-9


def test_tool_speeds_match_poses() -> None:
    slow = record("ur5e", 8.0, SERVO).moving()
    for name, noise in (("target", 1e-6), ("actual", 5e-3)):
        poses, speeds = slow.outputs[f"{name}_TCP_pose"], slow.outputs[f"{name}_TCP_speed"]
        displacement = poses[-1, :3] - poses[0, :3]
        assert speeds[1:, :3].sum(axis=0) * slow.period == pytest.approx(displacement, abs=noise)


def test_target_follows_speedj_one_cycle_later() -> None:
    robot = RtdeRobot(RtdeProfile(model="ur5e", start_delay_ms=0.0), START, T0, 7)
    controller = robot.controller
    text = (
        "def follow():\n  while True:\n"
        "    speedj([read_input_float_register(24), 0, 0, 0, 0, 0], a=20, t=0.002)\n  end\nend\n"
    )
    port = robot.connect(Port.SCRIPT, T0)
    assert port is not None
    port.receive(text.encode(), T0)
    controller.advance(T0 + 0.1)
    came = controller.snapshots[-1].time
    controller.write_inputs(("input_double_register_24",), {"input_double_register_24": 0.02})
    first = _first_cycle(controller, lambda: controller.snapshots[-1].target_speeds[0] > 0.0)
    assert first - came == pytest.approx(controller.period)


def _first_cycle(controller: Controller, holds: Callable[[], bool]) -> float:
    """Return the controller's clock in the first cycle in which the condition is true, s."""
    for _ in range(20):
        controller.advance(controller.now + controller.period)
        if holds():
            return controller.snapshots[-1].time
    raise AssertionError("it never holds")


def test_recording_follows_seed() -> None:
    one, again, other = (record.__wrapped__("ur5e", 1.0, SERVO, seed) for seed in (7, 7, 9))
    for name in NAMES:
        assert np.array_equal(one.outputs[name], again.outputs[name])
    assert not np.array_equal(one.outputs["actual_q"], other.outputs["actual_q"])
