"""Tests that every robot client must pass, for the author's test module.

    import pytest
    from hil_bridge.testing import RobotCase
    from hil_bridge.testing.robot_clients import *
    from my_package.room import ROBOT

    @pytest.fixture
    def robot_client():
        return RobotCase(ROBOT, stop=("robot", "emergency-stop"), numbered=True)

The client is the link that `ROBOT.connect` returns. It communicates with the emulated robot of the same kind in virtual
time, and its reports are compared with the true pose of that robot. `--hil-live KIND+URL` runs
`test_live_robot_reports` on a real robot.
"""

import math
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import pytest

from hil_bridge.errors import BridgeError
from hil_bridge.testing.cases import RobotCase, declared
from hil_bridge.testing.live import check_live_robot
from hil_bridge.testing.naming import Finding
from hil_bridge.testing.rig import try_each_fault
from hil_bridge.testing.robot_model import check_any_order
from hil_bridge.testing.robot_rig import LIMITS, SPEED_M_S, RobotRig, run_robot
from hil_bridge.testing.tampering import flipped, garbage, lengthened, shortened
from protocol.endpoint import ProtocolError
from protocol.geometry import Pose
from protocol.robot import RobotReport

__all__ = [
    "test_any_sequence_of_orders_holds_and_stops",
    "test_damaged_answers_are_not_believed",
    "test_leaving_a_movement_ends_it",
    "test_live_robot_reports",
    "test_nothing_is_ordered_after_a_halt",
    "test_order_that_is_no_number_is_refused",
    "test_pieces_of_answers_are_put_together",
    "test_report_during_a_movement_is_of_the_robot_and_not_of_the_order",
    "test_reports_tell_where_the_robot_is",
    "test_robot_client_cancelled_at_any_await_leaves_nothing",
    "test_robot_client_stands_every_fault_in_every_phase",
    "test_silent_robot_is_told",
    "test_speed_of_a_movement_is_kept",
    "test_stale_packet_is_no_new_report",
    "test_stopped_robot_gets_no_orders",
]

_PLACES: tuple[tuple[tuple[float, float, float], tuple[float, float, float]], ...] = (
    ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    ((6.0, 0.0, 0.0), (4.0, 0.0, 0.0)),
    ((6.0, -5.0, 4.0), (4.0, -3.0, 5.0)),
)
"""Test poses: offsets from the start, mm, and rotations about the base axes, °."""
_SETTLE_S = 0.8
_SPEED_S = 0.05
"""Averaging window of a speed, s."""
NOT_A_NUMBER = (BridgeError, ValueError, ProtocolError)
"""Exceptions by which an order with NaN may be refused: by the client, or by the robot."""


def test_reports_tell_where_the_robot_is(robot_client: RobotCase) -> None:
    """Unit, sign and order of the reported position and orientation match the true pose of the robot at several
    poses.
    """

    async def check(rig: RobotRig) -> None:
        async with rig.started() as link:
            newest = -math.inf
            for offset, turn in _PLACES:
                async with link.motion(LIMITS) as motion:
                    await rig.within(motion.to(rig.place(*offset, turn)), "to")
                    await rig.within(motion.settled(), "settled")
                await rig.wait(_SETTLE_S)
                report = await rig.within(link.report(), "report")
                rig.check_report(report)
                if report.sequence <= newest:
                    raise Finding(
                        f"the sequence number of a report does not increase: {report.sequence} after {newest:g}"
                    )
                newest = report.sequence
                away = math.dist(rig.true_pose().position, rig.place(*offset).position)
                if away > rig.case.tolerance_m:
                    raise Finding(f"the robot is {away * 1e3:.1f} mm away from the ordered position")

    run_robot(robot_client, check)


def test_report_during_a_movement_is_of_the_robot_and_not_of_the_order(robot_client: RobotCase) -> None:
    async def check(rig: RobotRig) -> None:
        target = rig.place(20.0, 0.0, 0.0)
        async with rig.started() as link, link.motion(LIMITS) as motion:
            await rig.within(motion.to(target), "to")
            for _ in range(3):
                report = await rig.within(link.report(), "report")
                to_target = math.dist(report.pose.position, target.position)
                remaining = math.dist(rig.true_pose(report.pose_at).position, target.position)
                if to_target < 1e-3 and remaining > 5e-3:
                    raise Finding(
                        "the commanded pose is reported as the actual one: a report contains the target, but the "
                        f"robot is still {remaining * 1e3:.1f} mm away from it"
                    )
                rig.check_report(report, SPEED_M_S)
            await rig.within(motion.settled(), "settled")

    run_robot(robot_client, check)


def test_speed_of_a_movement_is_kept(robot_client: RobotCase) -> None:
    async def check(rig: RobotRig) -> None:
        async with rig.started() as link, link.motion(LIMITS) as motion:
            await rig.within(motion.to(rig.place(28.0, 0.0, 0.0)), "to")
            for _ in range(15):
                before = rig.true_pose().position
                await rig.wait(_SPEED_S)
                speed = math.dist(before, rig.true_pose().position) / _SPEED_S
                if speed > 1.3 * SPEED_M_S + 0.01:
                    raise Finding(
                        f"the robot moves at {speed * 1e3:.0f} mm/s; allowed: at most {SPEED_M_S * 1e3:g} mm/s"
                    )
            await rig.within(motion.settled(), "settled")

    run_robot(robot_client, check)


def test_stale_packet_is_no_new_report(robot_client: RobotCase) -> None:
    """Stale packets, which the robot sent at another pose, arrive again among the current packets and are not
    reported.
    """
    declared(robot_client.numbered, "packets with a number or a time (RobotCase.numbered)")

    async def check(rig: RobotRig) -> None:
        async with rig.started() as link:
            for _ in range(3):
                await rig.within(link.report(), "report")
            wire = rig.wires[0]
            old = wire.arrivals[-1]
            async with link.motion(LIMITS) as motion:
                await rig.within(motion.to(rig.place(8.0, 0.0, 0.0)), "to")
                await rig.within(motion.settled(), "settled")
            await rig.wait(_SETTLE_S)
            wire.alter = lambda data: (data, old)
            newest = -math.inf
            for _ in range(20):
                report = await rig.within(link.report(), "report")
                try:
                    rig.check_report(report)
                except Finding as finding:
                    raise Finding(f"a stale packet was taken for a new report: {finding}") from None
                if report.sequence <= newest:
                    raise Finding("a stale packet was taken for a new report: its number was reported before")
                newest = report.sequence
            wire.alter = None

    run_robot(robot_client, check)


def test_stopped_robot_gets_no_orders(robot_client: RobotCase) -> None:
    """A stop during a movement is reported, and orders are refused. When the stop is lifted, the robot remains
    stationary.
    """
    declared(robot_client.stop, "a fault that stops the robot (RobotCase.stop)")
    assert robot_client.stop is not None
    target, fault = robot_client.stop

    async def check(rig: RobotRig) -> None:
        async with rig.started() as link:
            with suppress(BridgeError):
                async with link.motion(LIMITS) as motion:
                    await rig.within(motion.to(rig.place(25.0, 0.0, 0.0)), "to")
                    await rig.wait(0.2)
                    assert rig.inject(target, fault), (
                        f"the emulator does not support the fault {target}: {fault}"
                    )
                    await rig.wait(0.5)
                    await _check_stop_is_told(rig, link)
                    await rig.refused(
                        motion.to(rig.place(20.0, 0.0, 0.0)),
                        "to",
                        "an order is accepted while the robot reports a stop; it must be refused",
                    )
                    rig.mend()
                    await rig.wait(0.1)
                    await rig.check_stands("orders continued after a protective stop; it was lifted, and")
            await rig.check_stands("orders continued after a protective stop; the movement was left, and")

    run_robot(robot_client, check)


async def _check_stop_is_told(rig: RobotRig, link: object) -> None:
    with suppress(BridgeError):  # a robot that stops sending is reported by an error
        report = await rig.within(link.report(), "report")  # type: ignore[attr-defined]
        if not report.fault:
            raise Finding("a stop of the robot is not reported: the report has no fault")


def test_nothing_is_ordered_after_a_halt(robot_client: RobotCase) -> None:
    async def check(rig: RobotRig) -> None:
        async with rig.started() as link:
            for name in ("halt", "abandon"):
                async with link.motion(LIMITS) as motion:
                    await rig.within(motion.to(rig.place(20.0, 0.0, 0.0)), "to")
                    if name == "halt":
                        await rig.within(motion.halt(), "halt")
                        await rig.wait(0.5)
                        await rig.check_stands("a halted robot continues to move")
                    else:
                        motion.abandon()
                    await rig.refused(
                        motion.to(rig.place(10.0, 0.0, 0.0)),
                        "to",
                        f"an order is accepted after `{name}`; it must be refused",
                    )
                    await rig.wait(0.8)
                await rig.check_stands(f"a movement continues after `{name}`")

    run_robot(robot_client, check)


def test_leaving_a_movement_ends_it(robot_client: RobotCase) -> None:
    """Leaving a movement ends it at its last point, even after an exception. The movement then refuses further
    orders.
    """

    async def check(rig: RobotRig) -> None:
        async with rig.started() as link:
            async with link.motion(LIMITS) as left:
                await rig.within(left.to(rig.place(5.0, 0.0, 0.0)), "to")
            with suppress(ZeroDivisionError):
                async with link.motion(LIMITS) as broken:
                    await rig.within(broken.to(rig.place(10.0, 0.0, 0.0)), "to")
                    raise ZeroDivisionError
            await rig.wait(_SETTLE_S)
            await rig.check_stands("the robot continues to move after the movement was left")
            for motion in (left, broken):
                with suppress(BridgeError):
                    await rig.within(motion.to(rig.place(-10.0, 0.0, 0.0)), "to")
                await rig.check_stands("a movement still accepts orders after it was left")

    run_robot(robot_client, check)


def test_order_that_is_no_number_is_refused(robot_client: RobotCase) -> None:
    async def check(rig: RobotRig) -> None:
        good = rig.place(0.0, 0.0, 0.0)
        x, y, _z = good.position
        bad = [Pose((x, y, value), good.quaternion) for value in (math.nan, math.inf, -math.inf)]
        bad += [Pose(good.position, (0.0, 0.0, 0.0, 0.0)), Pose(good.position, (math.nan, 0.0, 0.0, 1.0))]
        async with rig.started() as link:
            for pose in bad:
                with suppress(BridgeError):
                    async with link.motion(LIMITS) as motion:
                        await rig.refused(
                            motion.to(pose),
                            "to",
                            f"an order with NaN is accepted: {pose}",
                            NOT_A_NUMBER,
                        )
                        motion.hold()
                await rig.check_stands(f"after an order to {pose}")

    run_robot(robot_client, check)


def test_silent_robot_is_told(robot_client: RobotCase) -> None:
    """While the cable is disconnected during a movement, each call fails before the timeout. After reconnection the
    robot is stationary.
    """

    async def check(rig: RobotRig) -> None:
        async with rig.started() as link:
            with suppress(BridgeError):
                async with link.motion(LIMITS) as motion:
                    await rig.within(motion.to(rig.place(20.0, 0.0, 0.0)), "to")
                    for wire in rig.wires:
                        wire.cut = True
                    await rig.wait(1.5)
                    for name, call in (
                        ("report", link.report),
                        ("to", lambda: motion.to(rig.place(5.0, 0.0, 0.0))),
                    ):
                        await rig.refused(
                            call(),
                            name,
                            f"`{name}` succeeds though the robot has been silent for more than a second",
                        )
            for wire in rig.wires:
                wire.cut = False
            await rig.wait(_SETTLE_S)
            await rig.check_stands(
                "the cable was disconnected and reconnected without a movement in progress, and"
            )

    run_robot(robot_client, check)


@pytest.mark.parametrize("damage", ["flipped", "shortened", "lengthened", "doubled", "garbage"])
def test_damaged_answers_are_not_believed(robot_client: RobotCase, damage: str) -> None:
    """Every fifth arrival is damaged. Calls may fail with a BridgeError, but no wrong value may be reported."""
    if damage == "flipped":
        declared(robot_client.checked, "packets with a checksum (RobotCase.checked)")
    alter: Callable[[Any, int], tuple[Any, ...]] = {
        "flipped": lambda data, count: (flipped(data, 37 * count),),
        "shortened": lambda data, count: (shortened(data),),
        "lengthened": lambda data, count: (lengthened(data),),
        "doubled": lambda data, count: (data, data),
        "garbage": lambda data, count: (garbage(data), data),
    }[damage]

    async def check(rig: RobotRig) -> None:
        count = 0

        def meddle(data: object) -> tuple[object, ...]:
            nonlocal count
            count += 1
            return (data,) if count % 5 else alter(data, count)

        with suppress(BridgeError):
            async with rig.started() as link:
                for wire in rig.wires:
                    wire.alter = meddle
                for _ in range(15):
                    with suppress(BridgeError):
                        report = await rig.within(link.report(), "report")
                        if not report.fault:
                            rig.check_report(report)
        await rig.check_stands("nothing was ordered, answers were damaged, and")

    run_robot(robot_client, check)


def test_pieces_of_answers_are_put_together(robot_client: RobotCase) -> None:
    """A byte wire splits data anywhere: first the bytes arrive one by one, then all bytes of 30 ms arrive together."""

    async def check(rig: RobotRig) -> None:
        async with rig.started() as link:
            if not all(isinstance(data, (bytes, bytearray)) for wire in rig.wires for data in wire.arrivals):
                pytest.skip("not a byte wire: data are not split")
            for wire in rig.wires:
                wire.alter = lambda data: [data[k : k + 1] for k in range(len(data))]
            for _ in range(5):
                rig.check_report(await rig.within(link.report(), "report"))
            async with link.motion(LIMITS) as motion:
                await rig.within(motion.to(rig.place(3.0, 0.0, 0.0)), "to")
                await rig.within(motion.settled(), "settled")
            await rig.wait(_SETTLE_S)
            rig.check_report(await rig.within(link.report(), "report"))

    run_robot(robot_client, check)


def test_robot_client_cancelled_at_any_await_leaves_nothing(robot_client: RobotCase) -> None:
    """Cancel a session at its first await, its second, and so on to its end.

    After each cancellation the wires must be closed, no task may remain, and the robot must be stationary.
    """

    async def check(rig: RobotRig) -> None:
        async def session() -> None:
            link = await rig.connect()
            try:
                link.start()
                await link.ready()
                async with link.motion(LIMITS) as motion:
                    await motion.to(rig.place(0.5, 0.0, 0.0))
                    await motion.settled()
                    await link.report()
            finally:
                await link.aclose()

        async def stands(number: int, where: str) -> None:
            if number % 5 == 0:
                await rig.check_stands(f"{where}, the client has ended, and")

        await rig.cancel_everywhere(session, stands)

    run_robot(robot_client, check)


@pytest.mark.parametrize("phase", ["idle", "moving"])
def test_robot_client_stands_every_fault_in_every_phase(robot_client: RobotCase, phase: str) -> None:
    """Under each fault of the emulator, calls raise only BridgeError, no call waits forever, and the robot stops."""
    assert robot_client.kind.emulation is not None

    def attempt(target: str, fault: str) -> None:
        async def check(rig: RobotRig) -> None:
            with suppress(BridgeError):
                async with rig.started() as link:
                    await _endure(rig, link, (target, fault), phase)
            rig.mend()
            await rig.wait(0.5)
            await rig.check_stands("the client has ended, and")

        run_robot(robot_client, check)

    try_each_fault(robot_client.kind, phase, attempt)


def _check_numbers(report: RobotReport) -> None:
    if not report.fault and not all(map(math.isfinite, (*report.pose.position, *report.pose.quaternion))):
        raise Finding(f"a pose that is not a number is reported without a fault: {report.pose}")


async def _endure(rig: RobotRig, link: object, fault: tuple[str, str], phase: str) -> None:
    """Inject a fault in one phase, and continue with the session as if nothing had happened."""
    robot: object = link
    if phase == "idle":
        rig.inject(*fault)
        await rig.wait(0.15)
        for _ in range(3):
            with suppress(BridgeError):
                _check_numbers(await rig.within(robot.report(), "report"))  # type: ignore[attr-defined]
        return
    async with robot.motion(LIMITS) as motion:  # type: ignore[attr-defined]
        await rig.within(motion.to(rig.place(4.0, 0.0, 0.0)), "to")
        rig.inject(*fault)
        await rig.wait(0.2)
        try:
            _check_numbers(await rig.within(robot.report(), "report"))  # type: ignore[attr-defined]
            await rig.within(motion.to(rig.place(0.0, 0.0, 0.0)), "to")
        except BridgeError:
            motion.abandon()


def test_any_sequence_of_orders_holds_and_stops(robot_client: RobotCase) -> None:
    """Orders, holds, halts, stops, cuts and pauses in any order agree with a model of the robot."""
    check_any_order(robot_client)


def test_live_robot_reports(robot_client: RobotCase, hil_live: list[str]) -> None:
    """Reports of a real robot arrive at its rate, are finite, and show a stationary robot. No orders are sent."""
    check_live_robot(robot_client, hil_live)
