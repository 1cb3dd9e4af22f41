"""The shell of robots that drive the cycle, with a small client and robot: answers, movements and their bounds."""

import asyncio
import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bridge.devices.robots.seam import Motion, MotionLimits
from hil_bridge.devices.robots.setpoint_responder import SetpointResponder
from hil_bridge.errors import DeviceError, OrderRefused
from protocol.geometry import Pose, towards
from tests.devices.streamed_toy import (
    ANSWER,
    CYCLE,
    DOWN,
    LIMITS,
    PACKET,
    SLACK,
    SPEED,
    START,
    Cell,
    ToyClient,
    angle,
    check_bounded,
    moved,
    run_cell,
)

# --- answers


def test_each_packet_is_answered_once_and_within_its_own_turn() -> None:
    async def script(cell: Cell) -> None:
        await cell.link.ready()
        async with cell.link.motion(LIMITS) as motion:
            for number in range(50):
                await motion.to(moved(number * 0.1))
                await cell.wait(0.02)

    cell = run_cell(script, "?latency_ms=0.5")
    answers = cell.robot.answers
    assert [sequence for _, sequence, _, _ in answers] == list(range(1, len(answers) + 1))
    took = [at - answers[0][0] - CYCLE * (sequence - 1) for at, sequence, _, _ in answers]
    assert took == [pytest.approx(0.0, abs=1e-9)] * len(answers)  # twice the latency and not a moment more
    assert cell.link.counters["late answers"] == 0
    assert set(cell.link.counters) - {"late answers"} == {"packets", "answers"}


def test_an_answer_carries_the_newest_target() -> None:
    async def script(cell: Cell) -> None:
        await cell.link.ready()
        async with cell.link.motion(LIMITS) as motion:
            await motion.to(moved(100.0))
            await motion.to(moved(-0.1))
            await cell.wait(1.5 * CYCLE)
            assert cell.robot.setpoints[-1].position == pytest.approx(moved(-0.1).position)

    run_cell(script)


def test_a_far_target_is_reached_at_the_limits_speed_exactly() -> None:
    times = []

    async def script(cell: Cell) -> None:
        await cell.link.ready()
        async with cell.link.motion(LIMITS) as motion:
            began = cell.clock.now()
            sent = await motion.to(moved(5.0))
            assert (sent.begun_at, math.isnan(sent.left_at), math.isnan(sent.accepted_at)) == (
                began,
                True,
                True,
            )
            await motion.settled()
            times.append(cell.clock.now() - began)
            motion.speed = SPEED / 2
            await motion.to(moved(0.0))
            await motion.settled()
            times.append(cell.clock.now() - began - times[0])
            assert motion.commanded == START.position

    cell = run_cell(script)
    assert times == [pytest.approx(0.1, abs=3 * CYCLE), pytest.approx(0.2, abs=3 * CYCLE)]
    assert moved(5.0) in cell.robot.setpoints
    assert cell.robot.setpoints[-1] == START
    check_bounded(cell.robot.setpoints)


def test_a_turn_is_bounded_too_and_ends_with_the_way() -> None:
    half = math.radians(10.0) / 2.0
    turned = Pose(moved(1.0).position, (0.0, math.cos(half), math.sin(half), 0.0))

    async def script(cell: Cell) -> None:
        await cell.link.ready()
        async with cell.link.motion(LIMITS) as motion:
            await motion.to(turned)

    cell = run_cell(script)
    assert cell.robot.setpoints[-1] == turned
    check_bounded(cell.robot.setpoints)
    middle = cell.robot.setpoints[len(cell.robot.setpoints) // 2]
    shares = (middle.position[0] - 0.9) / 1e-3, angle(START, middle) / (2 * half)
    assert shares[0] == pytest.approx(shares[1])


@given(
    st.lists(
        st.tuples(
            st.sampled_from([0.0, 0.0005, CYCLE, 2 * CYCLE, 0.05, 0.3]),
            st.integers(1, 3),
            st.floats(-20.0, 20.0),
            st.booleans(),
        ),
        max_size=60,
    )
)
def test_no_packets_and_targets_move_the_set_point_too_fast(
    course: list[tuple[float, int, float, bool]],
) -> None:
    """Packets that come in bursts, twice, late or not at all, and targets at any time."""
    client = ToyClient()
    answering = SetpointResponder(client, CYCLE)
    now, number = 1000.0, 10
    answering.begin(START, LIMITS, now)
    seen, at = [START], [now]
    for pause, step, target, again in course:
        now += pause
        number += 0 if again else step
        if again:
            answering.aim(moved(target), now)
        packets = [PACKET.pack(number, *START.position, *DOWN, False)] * (2 if again else 1)
        answering.receive(packets, now)
        answers = [ANSWER.unpack(answer) for answer in answering.data_to_send(now)]
        assert len(answers) == len(packets)
        for answer in answers:
            assert answer[1]
            seen.append(Pose(answer[2:5], answer[5:9]))
            at.append(now)
    check_bounded(seen)
    for first, last in itertools.combinations(range(0, len(seen), 5), 2):
        way = math.dist(seen[first].position, seen[last].position)
        passed = at[last] - at[first] + CYCLE  # a step may make up for a packet that came before
        assert way <= SPEED * passed + SLACK, "a burst adds up to a jump"


# --- the dead-man's switch


def test_a_silent_controller_has_the_robot_held_on_its_way() -> None:
    async def script(cell: Cell) -> None:
        await cell.link.ready()
        async with cell.link.motion(LIMITS) as motion:
            await motion.to(moved(100.0))
            await cell.wait(LIMITS.hold_after + 2 * CYCLE)
            held = cell.robot.pose
            assert held.position[0] - 0.9 == pytest.approx(SPEED * LIMITS.hold_after, abs=SPEED * 2 * CYCLE)
            await cell.wait(0.5)
            assert cell.robot.pose == held
            await motion.to(moved(100.0))
            await cell.wait(2 * CYCLE)
            assert cell.robot.pose.position[0] > held.position[0]
            motion.hold()

    cell = run_cell(script)
    assert cell.link.counters["holds"] == 1
    assert cell.notices == ["no new target for 0.1 s: the robot is held on its path"]
    check_bounded(cell.robot.setpoints)


@pytest.mark.parametrize("silent", [False, True])
def test_a_movement_without_targets_is_given_up_in_the_end(silent: bool) -> None:
    async def script(cell: Cell) -> None:
        await cell.link.ready()
        async with cell.link.motion(LIMITS) as motion:
            await motion.to(moved(0.1))
            cell.robot.silent = silent
            await cell.wait(LIMITS.give_up_after - 2 * CYCLE)
            assert cell.client.calls == ["begin"]
            await cell.wait(3 * CYCLE)
            assert cell.client.calls == ["begin", "end"]
            cell.robot.silent = False
            await cell.wait(3 * CYCLE)
            with pytest.raises(
                DeviceError, match="no new target for 2 s: the movement was ended; begin another"
            ):
                await motion.to(moved(0.2))
            motion.abandon()
        await cell.link.report()  # and the link continues
        async with cell.link.motion(LIMITS) as motion:
            await motion.to(moved(0.2))

    cell = run_cell(script)
    assert cell.client.calls == ["begin", "end"] * 2
    assert cell.robot.pose == moved(0.2)


def test_a_bug_of_the_caller_leaves_the_robot_where_it_was() -> None:
    async def script(cell: Cell) -> None:
        await cell.link.ready()

        async def run() -> None:
            async with cell.link.motion(LIMITS) as motion:
                await motion.to(moved(100.0))
                await cell.wait(0.05)
                raise ZeroDivisionError

        with pytest.raises(ZeroDivisionError):
            await run()
        left = cell.robot.pose
        await cell.wait(0.5)
        assert cell.robot.pose == left
        assert left.position[0] - 0.9 == pytest.approx(SPEED * 0.05, abs=SPEED * 2 * CYCLE)

    assert run_cell(script).client.calls == ["begin", "end"]


@pytest.mark.parametrize("moment", [0.0, 0.001, 0.004, 0.0061, 0.02, 0.05, 0.1001, 0.11])
def test_a_run_that_is_cancelled_at_any_moment_ends_the_movement(moment: float) -> None:
    async def script(cell: Cell) -> None:
        await cell.link.ready()

        async def run() -> None:
            async with cell.link.motion(LIMITS) as motion:
                await motion.to(moved(2.5))
                await motion.settled()
                await motion.to(moved(5.0))

        task = asyncio.create_task(run())
        await cell.wait(moment)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        assert cell.client.calls in ([], ["begin", "end"])
        left = cell.robot.answers[-1][3]
        await cell.wait(0.5)
        assert not cell.robot.answers[-1][2], "a movement continues"
        assert math.dist(cell.robot.pose.position, left.position) <= SPEED * CYCLE + SLACK

    run_cell(script)


# --- what a movement promises


def test_leaving_a_movement_ends_it_at_the_last_point() -> None:
    async def script(cell: Cell) -> None:
        await cell.link.ready()
        async with cell.link.motion(LIMITS) as motion:
            seam: Motion = motion
            assert (seam.ordered, seam.commanded) == (False, None)
            await seam.to(moved(1.0))
            await seam.to(moved(10.0))
            assert (seam.ordered, seam.commanded) == (True, moved(10.0).position)
        await cell.wait(2 * CYCLE)
        assert cell.robot.pose == moved(10.0)
        assert not cell.robot.answers[-1][2]
        with pytest.raises(DeviceError, match="the movement has ended; begin another movement"):
            await motion.to(moved(1.0))

    run_cell(script)


def test_halt_holds_at_once_and_takes_no_target_any_more() -> None:
    async def script(cell: Cell) -> None:
        await cell.link.ready()
        async with cell.link.motion(LIMITS) as motion:
            await motion.to(moved(100.0))
            await cell.wait(0.05)
            halted = cell.robot.setpoints[-1]
            await motion.halt()
            for order in (motion.to(moved(0.0)), motion.settled()):
                with pytest.raises(OrderRefused, match="was halted"):
                    await order
            await cell.wait(0.05)
            assert set(cell.robot.setpoints[-10:]) == {halted}
        assert (motion.halted, cell.client.calls) == (True, ["begin", "end"])

    run_cell(script)


def test_hold_gives_up_the_way_but_not_the_movement() -> None:
    async def script(cell: Cell) -> None:
        await cell.link.ready()
        async with cell.link.motion(LIMITS) as motion:
            await motion.to(moved(100.0))
            await cell.wait(0.05)
            held = cell.robot.setpoints[-1]
            motion.hold()
            await cell.wait(0.05)
            assert cell.robot.pose == held
            await motion.to(moved(0.0))
        motion.hold()  # harmless afterwards
        await cell.wait(2 * CYCLE)
        assert cell.robot.pose == START

    run_cell(script)


@pytest.mark.parametrize("pushed_mm", [0.0, 2.0], ids=["it stands", "it was pushed"])
def test_a_robot_with_a_fault_takes_targets_where_it_stood(pushed_mm: float) -> None:
    words = r"robot on udp\+memory:robot cannot move: protective stop; release it at the pendant"

    async def script(cell: Cell) -> None:
        await cell.link.ready()

        async def run() -> None:
            async with cell.link.motion(LIMITS) as motion:
                await motion.to(moved(100.0))
                await cell.wait(0.05)
                cell.robot.stopped = True
                await cell.wait(2 * CYCLE)
                stood = cell.robot.setpoints[-1]
                assert "protective stop" in (await cell.link.report()).fault
                with pytest.raises(OrderRefused, match=words):
                    await motion.to(moved(0.0))
                cell.robot.told_off_mm = pushed_mm
                cell.robot.stopped = False
                await cell.wait(0.05)
                assert bool((await cell.link.report()).fault) is bool(pushed_mm)
                assert set(cell.robot.setpoints[-10:]) == {stood}
                await motion.to(moved(0.0))

        if not pushed_mm:
            await run()
            assert cell.robot.pose.position == pytest.approx(START.position)
            return
        with pytest.raises(OrderRefused, match=words):
            await run()
        cell.robot.told_off_mm = 0.0
        async with cell.link.motion(LIMITS) as motion:
            await motion.to(moved(0.0))

    run_cell(script)


def test_no_movement_begins_during_a_fault_or_another_movement() -> None:
    async def script(cell: Cell) -> None:
        await cell.link.ready()
        async with cell.link.motion(LIMITS):
            with pytest.raises(OrderRefused, match="a movement is in progress"):
                async with cell.link.motion(LIMITS):
                    pytest.fail("two at a time")
        cell.robot.stopped = True
        await cell.wait(2 * CYCLE)
        with pytest.raises(DeviceError, match="protective stop"):
            await cell.link.ready()
        with pytest.raises(OrderRefused, match="protective stop"):
            async with cell.link.motion(LIMITS):
                pytest.fail("it cannot move")

    assert run_cell(script).client.calls == ["begin", "end"]


@pytest.mark.parametrize(
    ("target", "words"),
    [
        (Pose((math.nan, 0.0, 0.0), DOWN), "is not sent to the position"),
        (Pose((0.9, math.inf, 0.6), DOWN), "is not sent to the position"),
        (Pose(START.position, (0.0, 0.0, 0.0, 0.0)), "is not sent to the orientation"),
        (Pose(START.position, (math.nan, 1.0, 0.0, 0.0)), "is not sent to the orientation"),
    ],
)
def test_a_target_that_is_none_is_refused(target: Pose, words: str) -> None:
    async def script(cell: Cell) -> None:
        await cell.link.ready()
        async with cell.link.motion(LIMITS) as motion:
            with pytest.raises(OrderRefused, match=words):
                await motion.to(target)
            assert not motion.ordered

    assert set(run_cell(script).robot.setpoints) <= {START}


def test_a_reported_pose_that_is_none_is_a_fault() -> None:
    async def script(cell: Cell) -> None:
        await cell.link.ready()
        for pose in (Pose((math.nan, 0.0, 0.0), DOWN), Pose(START.position, (0.5, 0.0, 0.0, 0.0))):
            cell.robot.pose = pose
            await cell.wait(2 * CYCLE)
            with pytest.raises(OrderRefused, match=r"cannot move: reports the (position|orientation)"):
                async with cell.link.motion(LIMITS):
                    pytest.fail("where would it begin")

    run_cell(script)


# --- the way between two poses


parts = st.floats(-1.0, 1.0)
poses = st.builds(
    lambda position, q: Pose(position, tuple(part / math.hypot(*q) for part in q)),
    st.tuples(parts, parts, parts),
    st.tuples(parts, parts, parts, parts).filter(lambda q: math.hypot(*q) > 0.1),
)


@given(poses, poses, st.floats(1e-5, 1.0), st.floats(1e-4, 3.0))
def test_the_next_pose_is_nearer_and_not_too_far(
    start: Pose, goal: Pose, distance: float, turn: float
) -> None:
    there = towards(start, goal, distance, turn)
    assert math.dist(start.position, there.position) <= distance + 1e-12
    assert angle(start, there) <= turn + 1e-6
    assert math.dist(there.position, goal.position) <= math.dist(start.position, goal.position) + 1e-12
    assert angle(there, goal) <= angle(start, goal) + 1e-6
    assert math.hypot(*there.quaternion) == pytest.approx(1.0)


# --- the gain of speed


def test_a_movement_gains_and_loses_speed_by_its_acceleration_and_stops_at_once() -> None:
    limits = MotionLimits(SPEED)

    async def script(cell: Cell) -> None:
        await cell.link.ready()
        async with cell.link.motion(limits) as motion:
            await motion.to(moved(5.0))
            await motion.settled()
            await motion.to(moved(50.0))
            await cell.wait(0.1)
            motion.hold()
            cell.notices.append(str(len(cell.robot.setpoints)))
            await cell.wait(0.02)

    cell = run_cell(script)
    setpoints = cell.robot.setpoints
    held = int(cell.notices[-1])
    ways = [math.dist(a.position, b.position) / CYCLE for a, b in itertools.pairwise(setpoints[:held])]
    assert max(ways) == pytest.approx(SPEED)
    steps = [after - before for before, after in itertools.pairwise(ways)]
    assert max(map(abs, steps)) <= limits.acceleration * CYCLE + SLACK
    assert set(setpoints[held:]) == {setpoints[held]}  # held, without a way to come to rest
