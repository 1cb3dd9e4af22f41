"""Causes that other tests check only by their text: each is reached here, as a value."""

import asyncio
import dataclasses
import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
from msgspec.structs import replace

from hil_bridge import api
from hil_bridge.control import Clamp, Limits, Measurement, Request, Stop, Supervisor
from hil_bridge.control.course.answers import explain_halt
from hil_bridge.control.course.touch import Doubt, Touch, TouchTest
from hil_bridge.control.course.verdict import LEAVES, SLOWLY
from hil_bridge.devices.robots.gate import Bounds
from hil_bridge.devices.robots.seam import MotionLimits, fault_reason
from hil_bridge.errors import (
    BridgeError,
    Cause,
    ConfigError,
    DeviceError,
    OrderRefused,
    Part,
    Reason,
    TransportBroken,
)
from hil_bridge.errors.failures import CodeFailed, code_failed, explain_exception, link_cause
from hil_bridge.record.analysis.summary import end_of
from hil_bridge.runs.ending import Ending, result_after
from hil_bridge.runs.result import RunResult
from hil_bridge.runs.retreat import not_retracted_reason
from hil_bridge.runs.small_steps import bring_up
from hil_bridge.runs.zeroing import known_wrist
from hil_bridge.settings.configuration import read_config
from protocol.geometry import Pose
from protocol.robot import RobotReport
from tests.observed import observation, observed

DOWN = (0.0, 0.0, -1.0)
ORIGIN = (0.0, 0.0, 0.0)
SUPERVISOR = Supervisor(Limits(workspace_min_m=(-1.0, -1.0, -1.0), workspace_max_m=(1.0, 1.0, 0.01)))
QUIET = observation(5.0, 0.0, sequence=1, pressing=True, position=ORIGIN)


def request_of(mm: float) -> Request:
    return Request(mm * 1e-3, (0.0, 0.0, -mm * 1e-3), DOWN)


def judged(request: Request, **facts: Any) -> Any:
    return SUPERVISOR.step(SUPERVISOR.initial(ORIGIN), observed(QUIET, **facts), request)[1]


def test_nan_order_is_a_command_cause() -> None:
    verdict = judged(request_of(math.nan))
    assert isinstance(verdict, Stop)
    assert verdict.reason.cause is Cause.COMMAND_NOT_A_NUMBER


def test_late_frame_holds_inward_motion() -> None:
    verdict = judged(request_of(0.1), overdue=0.02)
    assert isinstance(verdict, Clamp)
    assert verdict.is_for(Cause.OVERDUE)
    assert verdict.goes_on


def test_too_fast_turn_is_clamped() -> None:
    turned = (math.cos(0.4), 0.0, 0.0, math.sin(0.4))
    state = SUPERVISOR.initial(ORIGIN)
    request = replace(request_of(0.0), quaternion=turned)
    verdict = SUPERVISOR.step(state, observed(QUIET, quaternion=(1.0, 0.0, 0.0, 0.0)), request)[1]
    assert isinstance(verdict, Clamp)
    assert verdict.is_for(Cause.TURN)


def test_retraction_without_force_slows_and_stops() -> None:
    state = SUPERVISOR.initial((0.0, 0.0, -5e-3), 5e-3)
    for depth, goes_on in ((5e-3, True), (0.0, False)):
        state = replace(state, depth=depth, position=(0.0, 0.0, -depth))
        verdict = SUPERVISOR.retreat(
            state, observed(QUIET, force=math.nan, pressing=False), request_of(-9.0)
        )[1]
        assert isinstance(verdict, Clamp)
        assert (verdict.is_for(Cause.NO_FORCE), verdict.goes_on) == (True, goes_on)


def test_held_retraction_names_its_cause() -> None:
    border, blind = (Clamp(0.0, ORIGIN, (hold,)) for hold in (LEAVES, SLOWLY))
    assert explain_halt(border, QUIET).cause is Cause.RETRACT_BORDER
    assert explain_halt(blind, QUIET).cause is Cause.RETRACT_BLIND
    failed = observed(QUIET, fault=Reason(Cause.SENSOR_FAILED, "it failed"))
    assert explain_halt(blind, failed) == Reason(Cause.SENSOR_FAILED, "it failed")


def test_failed_touch_names_its_cause() -> None:
    test = TouchTest(1.0, 1000.0, 0.0)
    came = Touch(Doubt.AXIS, arrived=1.0, began=(5.0, 0.0))
    deeper = Measurement(0.0, 5.0, 5e-3, 5e-3, dt=0.01)
    assert reason_cause(test.after(came, deeper)[2]) is Cause.UNANSWERED_TOUCH
    away = Measurement(0.0, 5.0, 0.0, 5e-3, dt=9.0)
    assert reason_cause(test.after(Touch(Doubt.AXIS), away)[2]) is Cause.UNTESTED_TOUCH


def reason_cause(reason: Reason | None) -> Cause | None:
    return None if reason is None else reason.cause


def test_config_refusal_names_its_row() -> None:
    with pytest.raises(ConfigError) as outside:
        SUPERVISOR.initial((5.0, 0.0, 0.0))
    with pytest.raises(ConfigError) as unknown:
        known_wrist(read_config({"sensor": {"url": "can+socketcan://can0"}}))
    with pytest.raises(ConfigError) as wrong:
        api.load({"run": {"duraton_s": 1.0}})
    causes = [each.value.cause for each in (outside, unknown, wrong)]
    assert causes == [Cause.START, Cause.UNKNOWN_TOOL, Cause.CONFIGURATION]


def test_device_failure_names_its_row() -> None:
    broken = TransportBroken("tcp://robot: broke")
    assert link_cause(broken) is Cause.CUT_WIRE
    assert code_failed("robot link", broken, link_cause(broken)).cause is Cause.CUT_WIRE
    failed = code_failed("robot link", ValueError("no"), link_cause(ValueError("no")))
    assert isinstance(failed, CodeFailed)
    assert failed.cause is Cause.ROBOT_FAILED


def test_unexpected_error_names_plugin() -> None:
    assert explain_exception(ValueError("no")).cause is Cause.BUG
    theirs = ValueError("no")
    theirs.blamed = (read_config, "none")  # type: ignore[attr-defined]
    assert explain_exception(theirs).cause is Cause.PLUGIN_CODE


def test_ends_around_movement_name_their_row() -> None:
    with pytest.raises(DeviceError) as cancelled:
        Ending().result_before(asyncio.CancelledError(), None)
    assert cancelled.value.cause is Cause.CANCELLED
    by_key = Ending()
    by_key.ask(Cause.KEY)
    assert by_key.result_before(asyncio.CancelledError(), None).cause is Cause.KEY
    written = result_after(RunResult(api.Outcome.COMPLETED), BridgeError("the disk is full"))
    assert (written.cause, written.exit_code) == (Cause.OUTPUT, 3)
    assert not_retracted_reason(5e-3, "1.0 N").cause is Cause.NOT_AWAY
    assert not_retracted_reason(math.nan, "1.0 N").cause is Cause.PLACE_UNKNOWN


def test_invalid_orientation_is_refused() -> None:
    none, well = (Pose(ORIGIN, quaternion) for quaternion in ((0.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)))
    for pose, cause in ((none, Cause.ORIENTATION), (well, Cause.ROBOT_STATE)):
        assert reason_cause(fault_reason(RobotReport(1, pose, 0.0, 0.0, "it cannot move"))) is cause
    assert fault_reason(RobotReport(1, well, 0.0, 0.0)) is None


def test_robot_moved_before_start_is_refused() -> None:
    async def main() -> OrderRefused:
        async with api.open_devices(EGM) as devices:
            (x, y, z), quaternion = (await devices.robot.ready()).pose
            planned = Bounds(Pose((x + 0.01, y, z), quaternion))
            with pytest.raises(OrderRefused) as refused:
                async with devices.robot.motion(MotionLimits(0.1, bounds=planned)):
                    pass
        return refused.value

    error = api.run_virtual(main)
    assert (error.cause, error.part) == (Cause.MOVED_BEFORE, Part.POSE)


def test_silent_ready_sensor_is_refused() -> None:
    async def at_once() -> None:
        """Ready."""

    async def never() -> None:
        await asyncio.sleep(1e6)

    robot: Any = SimpleNamespace(ready=at_once)
    sensor: Any = SimpleNamespace(name="can0", ready=at_once, frame=never)

    async def main() -> None:
        with pytest.raises(DeviceError, match="check its stream with hil-bridge probe sensor") as silent:
            await bring_up(robot, sensor)
        assert silent.value.cause is Cause.STREAM

    api.run_virtual(main)


def test_cut_recording_is_reported() -> None:
    recording = api.simulate({"run": {"duration_s": 0.2}}).recording
    assert end_of(dataclasses.replace(recording, end={})).cause is Cause.CUT


EGM: dict[str, Any] = {
    "robot": {"emulated": "egm"},
    "sensor": {"emulated": "netft"},
    "run": {"duration_s": 0.3},
}
S3: dict[str, Any] = {"run": {"duration_s": 0.3}}


def fault(on: str, name: str, phase: str = "connect", after_s: float = 0.0, **values: Any) -> dict[str, Any]:
    return {"on": on, "fault": name, "phase": phase, "after_s": after_s, "with": values}


RUNS: dict[Cause, tuple[dict[str, Any], list[dict[str, Any]]]] = {
    Cause.ROBOT_NOT_READY: (S3, [fault("robot", "emergency-stop")]),
    Cause.SENSOR_FAILED: (S3, [{**fault("sensor-wire", "off"), "for_s": 600.0}]),
    Cause.ZERO_SILENT: (
        {**S3, "robot": {"emulated": "egm"}},
        [{**fault("sensor-wire", "mute", "tare", 0.6), "for_s": 600.0}],
    ),
    Cause.UNSTEADY: (S3, [fault("signal", "drift", per_s=30.0)]),
    Cause.WEIGHT: (S3, [fault("signal", "dead")]),
    Cause.UNVERIFIED_AXIS: ({**S3, "cell": {"tool": {"mass_kg": 0.05}}}, []),
    Cause.LIFT_FOLLOW: (S3, [fault("pose", "frozen")]),
    Cause.LIFT_STATE: (S3, [fault("robot", "false-standby", "tare", 1.0)]),
    Cause.ZERO: ({**S3, "limits": {"zero_max_n": 0.01}, "sensor": {"unchecked": True}}, []),
    Cause.ROBOT_STATE: (EGM, [fault("robot", "motors-off", "track", 0.1)]),
}
"""Configuration and faults of a run that ends for each cause."""


def ended(
    settings: dict[str, Any], faults: list[dict[str, Any]], act: Callable[..., Any] | None = None
) -> Any:
    """The result of a run, whether it came to move or not."""
    kept: list[Any] = []

    async def main() -> None:
        async with api.simulation(settings, faults=faults, seed=7) as running:
            kept.append(running)
            if act is not None:
                await act(running)
            await running.finished()

    try:
        api.run_virtual(main)
    except BridgeError as error:
        if not kept:
            return error
    return kept[0].result


@pytest.mark.parametrize("cause", RUNS)
def test_run_ends_for_its_cause(cause: Cause) -> None:
    result = ended(*RUNS[cause])
    assert result.cause is cause, str(getattr(result, "text", result))


def test_interrupt_by_program_is_not_a_signal() -> None:
    async def interrupt(running: api.Simulation) -> None:
        await running.reached("track")
        running.interrupt()

    result = ended(S3, [], interrupt)
    assert (result.cause, result.outcome, result.text) == (Cause.INTERRUPTED, "interrupted", "")
