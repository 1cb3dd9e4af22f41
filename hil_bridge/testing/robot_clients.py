"""Tests that the client of every robot has to pass, for the test module of its author.

    import pytest
    from hil_bridge.testing import RobotCase
    from hil_bridge.testing.robot_clients import *
    from my_package.room import ROBOT

    @pytest.fixture
    def robot_client():
        return RobotCase(ROBOT, stop=("robot", "emergency-stop"), numbered=True)

The client is the link that `ROBOT.connect` makes. It speaks with the emulated robot of the same kind, in virtual time,
and is judged by where that robot truly is. `--hil-live KIND+URL` runs `test_live_robot_reports` on a real one.
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
"""Offsets from the start, mm, and turns about the base axes, degrees."""
_SETTLE_S = 0.8
_LOOK_S = 0.05
"""Time over which a speed is a mean, s."""
NOT_A_NUMBER = (BridgeError, ValueError, ProtocolError)
"""Errors that refuse an order to nowhere: the caller's mistake as well as the robot's."""


def test_reports_tell_where_the_robot_is(robot_client: RobotCase) -> None:
    """Unit, sign and order of position and orientation, by the robot's true pose at each of some places."""

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
                    raise Finding(f"the number of a report does not rise: {report.sequence} after {newest:g}")
                newest = report.sequence
                away = math.dist(rig.true_pose().position, rig.place(*offset).position)
                if away > rig.case.tolerance_m:
                    raise Finding(
                        f"the robot was ordered to a place and stands {away * 1e3:.1f} mm beside it"
                    )

    run_robot(robot_client, check)


def test_report_during_a_movement_is_of_the_robot_and_not_of_the_order(robot_client: RobotCase) -> None:
    async def check(rig: RobotRig) -> None:
        target = rig.place(20.0, 0.0, 0.0)
        async with rig.started() as link, link.motion(LIMITS) as motion:
            await rig.within(motion.to(target), "to")
            for _ in range(3):
                report = await rig.within(link.report(), "report")
                to_target = math.dist(report.pose.position, target.position)
                true_way = math.dist(rig.true_pose(report.pose_at).position, target.position)
                if to_target < 1e-3 and true_way > 5e-3:
                    raise Finding(
                        "the commanded pose is reported as the actual one: a report tells the target, and the robot "
                        f"is still {true_way * 1e3:.1f} mm away from it"
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
                await rig.wait(_LOOK_S)
                speed = math.dist(before, rig.true_pose().position) / _LOOK_S
                if speed > 1.3 * SPEED_M_S + 0.01:
                    raise Finding(f"the robot goes {speed * 1e3:.0f} mm/s, allowed were {SPEED_M_S * 1e3:g}")
            await rig.within(motion.settled(), "settled")

    run_robot(robot_client, check)


def test_stale_packet_is_no_new_report(robot_client: RobotCase) -> None:
    """Packets that the robot sent at another place come again, between those of now."""
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
                    raise Finding("a stale packet was taken for a new report: its number was told before")
                newest = report.sequence
            wire.alter = None

    run_robot(robot_client, check)


def test_stopped_robot_gets_no_orders(robot_client: RobotCase) -> None:
    """A stop comes in mid-movement. It is told, orders are refused, and once it is lifted the robot stands."""
    declared(robot_client.stop, "a fault that stops the robot (RobotCase.stop)")
    assert robot_client.stop is not None
    target, fault = robot_client.stop

    async def check(rig: RobotRig) -> None:
        async with rig.started() as link:
            with suppress(BridgeError):
                async with link.motion(LIMITS) as motion:
                    await rig.within(motion.to(rig.place(25.0, 0.0, 0.0)), "to")
                    await rig.wait(0.2)
                    assert rig.inject(target, fault), f"the emulator cannot have {target}: {fault}"
                    await rig.wait(0.5)
                    await _check_stop_is_told(rig, link)
                    await rig.refused(
                        motion.to(rig.place(20.0, 0.0, 0.0)),
                        "to",
                        "an order is taken while the robot reports a stop; it must be refused",
                    )
                    rig.mend()
                    await rig.wait(0.1)
                    await rig.check_stands("orders were sent on after a protective stop; it was lifted, and")
            await rig.check_stands("orders were sent on after a protective stop; the movement was left, and")

    run_robot(robot_client, check)


async def _check_stop_is_told(rig: RobotRig, link: object) -> None:
    with suppress(BridgeError):  # a robot that says nothing more is told by an error
        report = await rig.within(link.report(), "report")  # type: ignore[attr-defined]
        if not report.fault:
            raise Finding("a stop of the robot is not told: the report has no fault")


def test_nothing_is_ordered_after_a_halt(robot_client: RobotCase) -> None:
    async def check(rig: RobotRig) -> None:
        async with rig.started() as link:
            for name in ("halt", "abandon"):
                async with link.motion(LIMITS) as motion:
                    await rig.within(motion.to(rig.place(20.0, 0.0, 0.0)), "to")
                    if name == "halt":
                        await rig.within(motion.halt(), "halt")
                        await rig.wait(0.5)
                        await rig.check_stands("a robot that was halted continues")
                    else:
                        motion.abandon()
                    await rig.refused(
                        motion.to(rig.place(10.0, 0.0, 0.0)),
                        "to",
                        f"an order is taken after `{name}`; it must be refused",
                    )
                    await rig.wait(0.8)
                await rig.check_stands(f"a movement that was ended by `{name}` continues")

    run_robot(robot_client, check)


def test_leaving_a_movement_ends_it(robot_client: RobotCase) -> None:
    """At the last point; also after an exception, and then nothing more may be ordered by the same movement."""

    async def check(rig: RobotRig) -> None:
        async with rig.started() as link:
            async with link.motion(LIMITS) as left:
                await rig.within(left.to(rig.place(5.0, 0.0, 0.0)), "to")
            with suppress(ZeroDivisionError):
                async with link.motion(LIMITS) as broken:
                    await rig.within(broken.to(rig.place(10.0, 0.0, 0.0)), "to")
                    raise ZeroDivisionError
            await rig.wait(_SETTLE_S)
            await rig.check_stands("a movement that was left continues")
            for motion in (left, broken):
                with suppress(BridgeError):
                    await rig.within(motion.to(rig.place(-10.0, 0.0, 0.0)), "to")
                await rig.check_stands("a movement that was left still gives orders")

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
                            f"an order that is not a number is taken: {pose}",
                            NOT_A_NUMBER,
                        )
                        motion.hold()
                await rig.check_stands(f"after an order to {pose}")

    run_robot(robot_client, check)


def test_silent_robot_is_told(robot_client: RobotCase) -> None:
    """The cable is pulled in mid-movement: each call fails in time. Later it is in again, and the robot stands."""

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
            await rig.check_stands("the cable was pulled and is in again, no movement is under way, and")

    run_robot(robot_client, check)


@pytest.mark.parametrize("damage", ["flipped", "shortened", "lengthened", "doubled", "garbage"])
def test_damaged_answers_are_not_believed(robot_client: RobotCase, damage: str) -> None:
    """Every fifth arrival is damaged. Calls may fail with a BridgeError; nothing false may be reported."""
    if damage == "flipped":
        declared(robot_client.checked, "packets with a check (RobotCase.checked)")
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
    """A byte wire cuts anywhere: each byte comes alone, then all of 30 ms together."""

    async def check(rig: RobotRig) -> None:
        async with rig.started() as link:
            if not all(isinstance(data, (bytes, bytearray)) for wire in rig.wires for data in wire.arrivals):
                pytest.skip("not a byte wire: what is sent as one arrives as one")
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
    """A whole session is cancelled where it waits for the first time, the second time, and so on to its end. Then its
    wires are closed, no task is left, and the robot stands.
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
                await rig.check_stands(f"{where}, the client has gone, and")

        await rig.cancel_everywhere(session, stands)

    run_robot(robot_client, check)


@pytest.mark.parametrize("phase", ["idle", "moving"])
def test_robot_client_stands_every_fault_in_every_phase(robot_client: RobotCase, phase: str) -> None:
    """Each fault of the emulator: nothing but a BridgeError is raised, no call waits for ever, and the robot stands."""
    assert robot_client.kind.emulation is not None

    def attempt(target: str, fault: str) -> None:
        async def check(rig: RobotRig) -> None:
            with suppress(BridgeError):
                async with rig.started() as link:
                    await _through(rig, link, (target, fault), phase)
            rig.mend()
            await rig.wait(0.5)
            await rig.check_stands("the client has gone, and")

        run_robot(robot_client, check)

    try_each_fault(robot_client.kind, phase, attempt)


def _check_numbers(report: RobotReport) -> None:
    if not report.fault and not all(map(math.isfinite, (*report.pose.position, *report.pose.quaternion))):
        raise Finding(f"a pose that is not a number is reported without a fault: {report.pose}")


async def _through(rig: RobotRig, link: object, fault: tuple[str, str], phase: str) -> None:
    """Let it happen, and continue as if nothing had."""
    held: object = link
    if phase == "idle":
        rig.inject(*fault)
        await rig.wait(0.15)
        for _ in range(3):
            with suppress(BridgeError):
                _check_numbers(await rig.within(held.report(), "report"))  # type: ignore[attr-defined]
        return
    async with held.motion(LIMITS) as motion:  # type: ignore[attr-defined]
        await rig.within(motion.to(rig.place(4.0, 0.0, 0.0)), "to")
        rig.inject(*fault)
        await rig.wait(0.2)
        try:
            _check_numbers(await rig.within(held.report(), "report"))  # type: ignore[attr-defined]
            await rig.within(motion.to(rig.place(0.0, 0.0, 0.0)), "to")
        except BridgeError:
            motion.abandon()


def test_any_sequence_of_orders_holds_and_stops(robot_client: RobotCase) -> None:
    """Orders, holds, halts, stops, cuts and pauses in any order, against a model of the robot."""
    check_any_order(robot_client)


def test_live_robot_reports(robot_client: RobotCase, hil_live: list[str]) -> None:
    """A real robot: reports come at its pace, are numbers, and tell that it stands. Nothing is ordered."""
    check_live_robot(robot_client, hil_live)
