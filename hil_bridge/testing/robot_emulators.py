"""Tests that every robot emulator must pass, for the author's test module.

    import pytest
    from hil_bridge.testing import RobotCase
    from hil_bridge.testing.robot_emulators import *
    from my_package.room import ROBOT

    @pytest.fixture
    def robot_emulator():
        return RobotCase(ROBOT)

The tests use only the interface `emulators.seams.EmulatedRobot`, and send orders through the client of the same kind.
"""

import math
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
import pytest

from hil_bridge.errors import BridgeError
from hil_bridge.testing.cases import RobotCase
from hil_bridge.testing.naming import Finding
from hil_bridge.testing.rig import DAMAGES
from hil_bridge.testing.robot_rig import LIMITS, RobotRig, run_robot
from protocol.geometry import angle_between

__all__ = [
    "test_committed_path_never_changes",
    "test_every_fault_of_the_robot_can_begin",
    "test_hostile_bytes_neither_break_nor_move_it",
    "test_it_is_powered_up_where_it_is_told",
    "test_path_is_one_of_an_arm",
    "test_reading_changes_nothing",
    "test_same_seed_does_the_same",
    "test_targets_are_counted_and_begin_after_their_order",
    "test_without_orders_it_stands",
]

_FASTEST_M_S = 3.0
"""Largest plausible speed of an arm of this size, m/s. Chosen."""


async def _moved(rig: RobotRig) -> None:
    """Make a short movement forth and back."""
    async with rig.started() as link, link.motion(LIMITS) as motion:
        await rig.within(motion.to(rig.place(6.0, 3.0, 0.0)), "to")
        await rig.within(motion.settled(), "settled")
        await rig.within(motion.to(rig.place(0.0, 0.0, 2.0)), "to")
        await rig.within(motion.settled(), "settled")
    await rig.wait(0.3)


def _path(rig: RobotRig, since: float) -> np.ndarray[Any, Any]:
    times = np.arange(since, rig.clock.now(), 0.002)
    positions: np.ndarray[Any, Any] = rig.robot.path.trajectory(times)[0]
    return positions


def test_it_is_powered_up_where_it_is_told(robot_emulator: RobotCase) -> None:
    async def check(rig: RobotRig) -> None:
        true, start = rig.true_pose(), rig.case.start
        if math.dist(true.position, start.position) > 1e-6:
            raise Finding(f"the robot starts at {true.position}, not at the given position {start.position}")
        if angle_between(true.quaternion, start.quaternion) > 1e-6:
            raise Finding(
                f"the robot starts with the orientation {true.quaternion}, not the given one {start.quaternion}"
            )
        if abs(math.hypot(*true.quaternion) - 1.0) > 1e-6:
            raise Finding(f"an orientation of the path is not a unit quaternion: {true.quaternion}")

    run_robot(robot_emulator, check)


def test_without_orders_it_stands(robot_emulator: RobotCase) -> None:
    async def check(rig: RobotRig) -> None:
        async with rig.started() as link:
            await rig.wait(1.0)
            await rig.within(link.report(), "report")
            await rig.check_stands("nothing was ordered, and")

    run_robot(robot_emulator, check)


def test_path_is_one_of_an_arm(robot_emulator: RobotCase) -> None:
    """The path of the tool has no jumps, and its velocities match its positions."""

    async def check(rig: RobotRig) -> None:
        begin = rig.clock.now()
        await _moved(rig)
        times = np.arange(begin, rig.clock.now(), 0.001)
        positions, velocities = rig.robot.path.trajectory(times)
        if not (np.isfinite(positions).all() and np.isfinite(velocities).all()):
            raise Finding("the path contains NaN")
        steps = np.diff(positions, axis=0) / 0.001
        fastest = float(np.linalg.norm(steps, axis=1).max())
        if fastest > _FASTEST_M_S:
            raise Finding(f"the path jumps: {fastest:.1f} m/s from one millisecond to the next")
        between = (velocities[1:] + velocities[:-1]) / 2.0
        if float(np.abs(between - steps).mean()) > 0.05 * float(np.abs(steps).max()) + 1e-4:
            raise Finding("the velocities of the path do not match its positions")

    run_robot(robot_emulator, check)


def test_committed_path_never_changes(robot_emulator: RobotCase) -> None:
    """Once the committed path has been read, a further order does not change the part that was read."""

    async def check(rig: RobotRig) -> None:
        path, now = rig.robot.path, rig.clock.now
        async with rig.started() as link, link.motion(LIMITS) as motion:
            for x in (20.0, -15.0, 10.0):
                await rig.within(motion.to(rig.place(x, 0.0, 0.0)), "to")
                await rig.wait(0.25)
                until = path.committed_until(now())
                if until < now():
                    raise Finding(
                        f"the path is committed only up to {until:g} s, but the time is {now():g} s"
                    )
                times = np.linspace(now() - 0.05, until, 50, endpoint=False)
                before = path.trajectory(times)[0].copy()
                await rig.within(motion.to(rig.place(-x, 2.0, 0.0)), "to")
                await rig.wait(0.2)
                if np.abs(path.trajectory(times)[0] - before).max() > 1e-9:
                    raise Finding("an order changed the committed part of the path")

    run_robot(robot_emulator, check)


def _run_once(case: RobotCase, meddle: Callable[[RobotRig], None] = lambda rig: None) -> np.ndarray[Any, Any]:
    paths: list[np.ndarray[Any, Any]] = []

    async def check(rig: RobotRig) -> None:
        begin = rig.clock.now()
        meddle(rig)
        await _moved(rig)
        paths.append(_path(rig, begin))

    run_robot(case, check)
    return paths[0]


def test_same_seed_does_the_same(robot_emulator: RobotCase) -> None:
    first, again = _run_once(robot_emulator), _run_once(robot_emulator)
    if first.shape != again.shape or not np.array_equal(first, again):
        raise Finding("two robots with the same seed and orders took different paths")


def test_reading_changes_nothing(robot_emulator: RobotCase) -> None:
    """Reading the path repeatedly does not change the motion."""

    def read_often(rig: RobotRig) -> None:
        def read() -> None:
            path, now = rig.robot.path, rig.clock.now()
            path.trajectory(np.linspace(now, path.predicted_until(now), 5))
            path.orientations(np.array([now]))
            rig.robot.targets.begun_at(1)
            rig.robot.joints_holding(rig.true_pose(), now)
            if not rig.over:
                rig.clock.call_at(now + 0.013, read)

        rig.clock.call_soon(read)

    quiet, read = _run_once(robot_emulator), _run_once(robot_emulator, read_often)
    if quiet.shape != read.shape or np.abs(quiet - read).max() > 1e-9:
        raise Finding("reading the path changed the path of the robot")


def test_targets_are_counted_and_begin_after_their_order(robot_emulator: RobotCase) -> None:
    async def check(rig: RobotRig) -> None:
        robot = rig.robot
        async with rig.started() as link, link.motion(LIMITS) as motion:
            before, ordered_at = robot.targets.accepted, rig.clock.now()
            await rig.within(motion.to(rig.place(6.0, 0.0, 0.0)), "to")
            await rig.within(motion.settled(), "settled")
            await rig.wait(1.0)
            robot.path.advance(rig.clock.now())
            if robot.targets.accepted <= before:
                raise Finding(f"an order was accepted, but `accepted` stays at {robot.targets.accepted}")
            begun = [
                robot.targets.begun_at(number) for number in range(before + 1, robot.targets.accepted + 1)
            ]
            known = [at for at in begun if at is not None and not math.isnan(at)]
            if not known:
                raise Finding(f"the robot has moved, but none of {robot.targets.accepted} targets has begun")
            if min(known) < ordered_at or known != sorted(known):
                raise Finding("a target began before it was ordered, or before an earlier one")
            if robot.targets.begun_at(robot.targets.accepted + 1000) is not None:
                raise Finding("a target began that was never ordered")

    run_robot(robot_emulator, check)


@pytest.mark.parametrize("damage", DAMAGES)
def test_hostile_bytes_neither_break_nor_move_it(robot_emulator: RobotCase, damage: str) -> None:
    """When the client sends damaged bytes, the emulator raises no error, does not move far, and finally stops."""

    async def check(rig: RobotRig) -> None:
        with suppress(BridgeError):
            link = await rig.connect()
            try:
                rig.damage_sent(damage, 3, 3)
                link.start()
                await rig.within(link.ready(), "ready")
                for _ in range(5):
                    with suppress(BridgeError):
                        await rig.within(link.report(), "report")
            finally:
                await link.aclose()
        await rig.wait(1.0)
        await rig.check_stands("damaged orders arrived, then none, and")
        if not all(map(math.isfinite, rig.true_pose().position)):
            raise Finding("the position of the robot is not a number")

    run_robot(robot_emulator, check)


def test_every_fault_of_the_robot_can_begin(robot_emulator: RobotCase) -> None:
    async def check(rig: RobotRig) -> None:
        async with rig.started():
            await rig.begin_each(rig.robot.handlers, "robot")

    with suppress(BridgeError):
        run_robot(robot_emulator, check)
