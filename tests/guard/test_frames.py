"""Robots that report their pose in another frame, or briefly not at all: the tool neither strays nor keeps pressing."""

import math
from collections.abc import Callable
from typing import Any

import pytest

from emulators.devices.egm import reporter
from hil_bridge.settings.configuration import Config
from protocol.devices.egm import PoseMm, to_wire
from protocol.devices.egm.frames import STOOD_S, Frames
from protocol.devices.rtde.rotation import pose_of
from protocol.geometry import Pose, angle_between
from protocol.robot import pose_fault
from tests.near_surface import awake_config

pytestmark = pytest.mark.sweep

Guarded = Any
Run = Callable[..., Guarded]
UPRIGHT = (0.0, 1.0, 0.0, 0.0)


def tracking(robot: str, stiffness: float, *faults: dict[str, Any], mode: str = "") -> Config:
    """A moment of tracking with an emulated robot that streams, and a Net F/T; `mode` is that of an RSI robot."""
    robots: dict[str, Any] = {"emulated": robot}
    cell: dict[str, Any] = {}
    if mode:
        robots["rsi"] = cell["rsi"] = {"mode": mode}
    return awake_config(
        {
            "run": {"duration_s": 1.0, "period_ms": 20},
            "controller": {"sample_ms": 20},
            "robot": robots,
            "sensor": {"emulated": "netft"},
            "cell": {
                **cell,
                "start_position_mm": (900.0, -100.0, 591.0),
                "surface": {"stiffness_n_m": stiffness},
            },
            "task": {"retract_speed_mm_s": 20.0, "retract_mm": 4.0},
            "faults": faults,
        }
    )


def offset(z_mm: float, phase: str) -> dict[str, Any]:
    return {"on": "pose", "fault": "offset", "phase": phase, "for_s": 600.0, "with": {"z_mm": z_mm}}


@pytest.mark.parametrize("robot", ["egm", "rtde"])
@pytest.mark.parametrize("stiffness", [5e3, 5e4])
@pytest.mark.parametrize("phase", ["connect", "tare"])
@pytest.mark.parametrize("z_mm", [-30.0, -5.0])
def test_wrong_reported_pose_is_refused(
    guarded: Run, robot: str, stiffness: float, phase: str, z_mm: float
) -> None:
    """An answer made of its pose would lead it 30 mm deeper."""
    run = guarded(tracking(robot, stiffness, offset(z_mm, phase)))
    assert f"it reports a pose {-z_mm:.1f} mm and 0.0° from its own" in run.cause
    assert run.largest == 0.0
    assert run.result.left == ""


@pytest.mark.parametrize("phase", ["connect", "tare"])
@pytest.mark.parametrize("mode", ["absolute", "relative"])
def test_corrections_ignore_wrong_pose(guarded: Run, mode: str, phase: str) -> None:
    """The client attributes the difference to an earlier correction and accepts the pose."""
    config = tracking("rsi", 5e4, offset(-30.0, phase), mode=mode)
    run = guarded(config)
    assert run.largest <= config.limits.force_limit_n
    assert run.last == pytest.approx(0.0, abs=0.2)


@pytest.mark.parametrize("phase", ["connect", "tare"])
@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ({"fault": "offset", "with": {"x_mm": 30.0}}, "moved by 30.0 mm and turned by 0.0°"),
        ({"fault": "turned", "with": {"axis": "z", "degrees": 90.0}}, "moved by 0.0 mm and turned by 90.0°"),
    ],
)
def test_robot_moved_since_check_is_refused(
    guarded: Run, phase: str, fault: dict[str, Any], message: str
) -> None:
    """Its first order would be a jump, which the last gate stops as a bug."""
    late = {"on": "pose", "phase": phase, "after_s": 0.1, "for_s": 600.0, **fault}
    run = guarded(tracking("rsi", 5e4, late))
    assert message in run.cause
    assert "the last gate" not in run.cause
    assert run.largest == 0.0
    assert run.result.left == ""


def test_pose_in_metres_is_refused(guarded: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """The reported position would be a thousandth of the true one, inside the robot's base."""

    def in_metres(pose: Pose) -> PoseMm:
        return PoseMm(pose.position, pose.quaternion)

    monkeypatch.setattr(reporter, "to_wire", in_metres)
    run = guarded(tracking("egm", 5e4))
    assert "1.1 mm from the origin of its base" in run.cause
    assert "and millimetres" in run.cause
    assert run.largest == 0.0


def at(z_mm: float, quaternion: tuple[float, float, float, float] = UPRIGHT) -> PoseMm:
    return to_wire(Pose((0.9, -0.1, 0.59 + z_mm * 1e-3), quaternion))


def test_moving_set_point_is_not_compared() -> None:
    frames = Frames()
    assert not frames.fault(at(0.0), at(0.0), 0.0)
    for number in range(1, 20):
        assert not frames.fault(at(number - 3.0), at(float(number)), number * 0.004), "it lags"
    assert not frames.fault(at(16.0), at(19.0), 19 * 0.004 + STOOD_S / 2)
    assert "3.0 mm and 0.0°" in frames.fault(at(16.0), at(19.0), 19 * 0.004 + STOOD_S + 0.01).fact
    assert not frames.fault(at(19.0), at(19.0), 1.0), "the fault was injected"


def test_rotated_pose_is_compared() -> None:
    half = math.radians(5.0) / 2.0
    turned = (0.0, math.cos(half), math.sin(half), 0.0)
    assert "0.0 mm and 5.0°" in Frames().fault(at(0.0, turned), at(0.0), 0.0).fact


def test_set_point_away_from_answer_ends_stream() -> None:
    """The robot reads poses in one work object and reports them in another."""
    frames = Frames()
    assert not frames.leaves(at(0.0), at(0.0), 0.0)
    assert not frames.leaves(at(0.0), at(-0.9), 0.1)
    message = frames.leaves(at(0.0), at(-1.1), 0.104)
    assert "went 1.1 mm away from a constant answer" in message.fact
    assert frames.leaves(at(0.0), at(0.0), 0.108) == message, "for the rest of the session"
    assert frames.fault(at(0.0), at(0.0), 0.108) == message


def test_too_long_rotation_is_invalid() -> None:
    pose = pose_of((0.9, -0.1, 0.59, 1.7e308, 1.7e308, 0.0))
    assert "which is invalid" in pose_fault(pose)
    assert angle_between(UPRIGHT, (0.0, -1.0, 0.0, 0.0)) == 0.0
    assert angle_between(UPRIGHT, (1.0, 0.0, 0.0, 0.0)) == pytest.approx(math.pi)


MOMENTS: dict[str, tuple[str, dict[str, Any]]] = {
    "EGM tells no number once": ("egm", {"on": "pose", "fault": "nan", "with": {"count": 1}}),
    "EGM tells no pose once": ("egm", {"on": "pose", "fault": "missing", "with": {"count": 1}}),
    "RTDE tells no number for 20 ms": ("rtde", {"on": "pose", "fault": "nan", "for_s": 0.02}),
}


@pytest.mark.parametrize("stiffness", [5e3, 5e4])
@pytest.mark.parametrize(("robot", "fault"), MOMENTS.values(), ids=MOMENTS)
def test_missing_pose_leaves_no_tool_pressing(
    guarded: Run, robot: str, fault: dict[str, Any], stiffness: float
) -> None:
    run = guarded(tracking(robot, stiffness, {**fault, "phase": "track", "after_s": 0.5}))
    messages = "which is invalid", "it reports no pose", "is not a number"
    assert any(word in run.cause for word in messages)
    assert run.largest <= 50.0
    assert run.last == 0.0
    assert run.result.left.startswith("retracted, 0."), (
        "a tool that tilts with its arm changes its apparent weight"
    )
