"""Link of robots that drive the cycle, with a small client and robot: answers, movements and their limits."""

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
    displaced,
    run_cell,
)

# --- answers


def test_stream_answers_each_packet_once_at_once() -> None:
    async def script(cell: Cell) -> None:
        await cell.link.ready()
        async with cell.link.motion(LIMITS) as motion:
            for number in range(50):
                await motion.to(displaced(number * 0.1))
                await cell.wait(0.02)

    cell = run_cell(script, "?latency_ms=0.5")
    answers = cell.robot.answers
    assert [sequence for _, sequence, _, _ in answers] == list(range(1, len(answers) + 1))
    delays = [at - answers[0][0] - CYCLE * (sequence - 1) for at, sequence, _, _ in answers]
    assert delays == [pytest.approx(0.0, abs=1e-9)] * len(answers)  # exactly twice the latency
    assert cell.link.counters["late answers"] == 0
    assert set(cell.link.counters) - {"late answers"} == {"packets", "answers"}


def test_stream_answer_contains_newest_target() -> None:
    async def script(cell: Cell) -> None:
        await cell.link.ready()
        async with cell.link.motion(LIMITS) as motion:
            await motion.to(displaced(100.0))
            await motion.to(displaced(-0.1))
            await cell.wait(1.5 * CYCLE)
            assert cell.robot.setpoints[-1].position == pytest.approx(displaced(-0.1).position)

    run_cell(script)


def test_stream_reaches_far_target_at_speed_limit() -> None:
    times = []

    async def script(cell: Cell) -> None:
        await cell.link.ready()
        async with cell.link.motion(LIMITS) as motion:
            began = cell.clock.now()
            sent = await motion.to(displaced(5.0))
            assert (sent.begun_at, math.isnan(sent.left_at), math.isnan(sent.accepted_at)) == (
                began,
                True,
                True,
            )
            await motion.settled()
            times.append(cell.clock.now() - began)
            motion.speed = SPEED / 2
            await motion.to(displaced(0.0))
            await motion.settled()
            times.append(cell.clock.now() - began - times[0])
            assert motion.commanded == START.position

    cell = run_cell(script)
    assert times == [pytest.approx(0.1, abs=3 * CYCLE), pytest.approx(0.2, abs=3 * CYCLE)]
    assert displaced(5.0) in cell.robot.setpoints
    assert cell.robot.setpoints[-1] == START
    check_bounded(cell.robot.setpoints)


def test_stream_limits_rotation_and_ends_it_with_path() -> None:
    half = math.radians(10.0) / 2.0
    turned = Pose(displaced(1.0).position, (0.0, math.cos(half), math.sin(half), 0.0))

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
def test_stream_never_moves_set_point_too_fast(
    course: list[tuple[float, int, float, bool]],
) -> None:
    """Packets arrive in bursts, twice, late or not at all, and targets change at any time."""
    client = ToyClient()
    answering = SetpointResponder(client, CYCLE)
    now, number = 1000.0, 10
    answering.begin(START, LIMITS, now)
    poses, at = [START], [now]
    for pause, step, target, again in course:
        now += pause
        number += 0 if again else step
        if again:
            answering.aim(displaced(target), now)
        packets = [PACKET.pack(number, *START.position, *DOWN, False)] * (2 if again else 1)
        answering.receive(packets, now)
        answers = [ANSWER.unpack(answer) for answer in answering.data_to_send(now)]
        assert len(answers) == len(packets)
        for answer in answers:
            assert answer[1]
            poses.append(Pose(answer[2:5], answer[5:9]))
            at.append(now)
    check_bounded(poses)
    for first, last in itertools.combinations(range(0, len(poses), 5), 2):
        distance = math.dist(poses[first].position, poses[last].position)
        elapsed = at[last] - at[first] + CYCLE  # a step may compensate for an earlier packet
        assert distance <= SPEED * elapsed + SLACK, "a burst causes a jump"


# --- the dead-man's switch


def test_stream_without_new_target_holds_set_point() -> None:
    async def script(cell: Cell) -> None:
        await cell.link.ready()
        async with cell.link.motion(LIMITS) as motion:
            await motion.to(displaced(100.0))
            await cell.wait(LIMITS.hold_after + 2 * CYCLE)
            set_point = cell.robot.pose
            assert set_point.position[0] - 0.9 == pytest.approx(
                SPEED * LIMITS.hold_after, abs=SPEED * 2 * CYCLE
            )
            await cell.wait(0.5)
            assert cell.robot.pose == set_point
            await motion.to(displaced(100.0))
            await cell.wait(2 * CYCLE)
            assert cell.robot.pose.position[0] > set_point.position[0]
            motion.hold()

    cell = run_cell(script)
    assert cell.link.counters["holds"] == 1
    assert cell.notices == ["no new target for 0.1 s: the robot is held on its path"]
    check_bounded(cell.robot.setpoints)


@pytest.mark.parametrize("silent", [False, True])
def test_stream_without_targets_ends_movement(silent: bool) -> None:
    async def script(cell: Cell) -> None:
        await cell.link.ready()
        async with cell.link.motion(LIMITS) as motion:
            await motion.to(displaced(0.1))
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
                await motion.to(displaced(0.2))
            motion.abandon()
        await cell.link.report()  # and the link continues
        async with cell.link.motion(LIMITS) as motion:
            await motion.to(displaced(0.2))

    cell = run_cell(script)
    assert cell.client.calls == ["begin", "end"] * 2
    assert cell.robot.pose == displaced(0.2)


def test_stream_exception_of_caller_stops_robot() -> None:
    async def script(cell: Cell) -> None:
        await cell.link.ready()

        async def run() -> None:
            async with cell.link.motion(LIMITS) as motion:
                await motion.to(displaced(100.0))
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
def test_stream_cancelled_run_ends_movement(moment: float) -> None:
    async def script(cell: Cell) -> None:
        await cell.link.ready()

        async def run() -> None:
            async with cell.link.motion(LIMITS) as motion:
                await motion.to(displaced(2.5))
                await motion.settled()
                await motion.to(displaced(5.0))

        task = asyncio.create_task(run())
        await cell.wait(moment)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        assert cell.client.calls in ([], ["begin", "end"])
        left = cell.robot.answers[-1][3]
        await cell.wait(0.5)
        assert not cell.robot.answers[-1][2], "the movement continues"
        assert math.dist(cell.robot.pose.position, left.position) <= SPEED * CYCLE + SLACK

    run_cell(script)


# --- what a movement promises


def test_stream_movement_ends_at_last_point() -> None:
    async def script(cell: Cell) -> None:
        await cell.link.ready()
        async with cell.link.motion(LIMITS) as motion:
            seam: Motion = motion
            assert (seam.ordered, seam.commanded) == (False, None)
            await seam.to(displaced(1.0))
            await seam.to(displaced(10.0))
            assert (seam.ordered, seam.commanded) == (True, displaced(10.0).position)
        await cell.wait(2 * CYCLE)
        assert cell.robot.pose == displaced(10.0)
        assert not cell.robot.answers[-1][2]
        with pytest.raises(DeviceError, match="the movement has ended; begin another movement"):
            await motion.to(displaced(1.0))

    run_cell(script)


def test_stream_halt_stops_at_once_and_refuses_targets() -> None:
    async def script(cell: Cell) -> None:
        await cell.link.ready()
        async with cell.link.motion(LIMITS) as motion:
            await motion.to(displaced(100.0))
            await cell.wait(0.05)
            halted = cell.robot.setpoints[-1]
            await motion.halt()
            for order in (motion.to(displaced(0.0)), motion.settled()):
                with pytest.raises(OrderRefused, match="was halted"):
                    await order
            await cell.wait(0.05)
            assert set(cell.robot.setpoints[-10:]) == {halted}
        assert (motion.halted, cell.client.calls) == (True, ["begin", "end"])

    run_cell(script)


def test_stream_hold_discards_path_and_keeps_movement() -> None:
    async def script(cell: Cell) -> None:
        await cell.link.ready()
        async with cell.link.motion(LIMITS) as motion:
            await motion.to(displaced(100.0))
            await cell.wait(0.05)
            set_point = cell.robot.setpoints[-1]
            motion.hold()
            await cell.wait(0.05)
            assert cell.robot.pose == set_point
            await motion.to(displaced(0.0))
        motion.hold()  # harmless afterwards
        await cell.wait(2 * CYCLE)
        assert cell.robot.pose == START

    run_cell(script)


@pytest.mark.parametrize("pushed_mm", [0.0, 2.0], ids=["stationary", "pushed"])
def test_stream_accepts_targets_after_fault_at_set_point(pushed_mm: float) -> None:
    message = r"the robot cannot move: protective stop; release it at the pendant"

    async def script(cell: Cell) -> None:
        await cell.link.ready()

        async def run() -> None:
            async with cell.link.motion(LIMITS) as motion:
                await motion.to(displaced(100.0))
                await cell.wait(0.05)
                cell.robot.stopped = True
                await cell.wait(2 * CYCLE)
                position = cell.robot.setpoints[-1]
                assert "protective stop" in (await cell.link.report()).fault
                with pytest.raises(OrderRefused, match=message):
                    await motion.to(displaced(0.0))
                cell.robot.reported_offset_mm = pushed_mm
                cell.robot.stopped = False
                await cell.wait(0.05)
                assert bool((await cell.link.report()).fault) is bool(pushed_mm)
                assert set(cell.robot.setpoints[-10:]) == {position}
                await motion.to(displaced(0.0))

        if not pushed_mm:
            await run()
            assert cell.robot.pose.position == pytest.approx(START.position)
            return
        with pytest.raises(OrderRefused, match=message):
            await run()
        cell.robot.reported_offset_mm = 0.0
        async with cell.link.motion(LIMITS) as motion:
            await motion.to(displaced(0.0))

    run_cell(script)


def test_stream_refuses_movement_during_fault_or_movement() -> None:
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
    ("target", "message"),
    [
        (Pose((math.nan, 0.0, 0.0), DOWN), "is not sent to the position"),
        (Pose((0.9, math.inf, 0.6), DOWN), "is not sent to the position"),
        (Pose(START.position, (0.0, 0.0, 0.0, 0.0)), "is not sent to the orientation"),
        (Pose(START.position, (math.nan, 1.0, 0.0, 0.0)), "is not sent to the orientation"),
    ],
)
def test_stream_invalid_target_is_refused(target: Pose, message: str) -> None:
    async def script(cell: Cell) -> None:
        await cell.link.ready()
        async with cell.link.motion(LIMITS) as motion:
            with pytest.raises(OrderRefused, match=message):
                await motion.to(target)
            assert not motion.ordered

    assert set(run_cell(script).robot.setpoints) <= {START}


def test_stream_invalid_reported_pose_is_fault() -> None:
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
def test_stream_next_pose_approaches_target_within_limit(
    start: Pose, goal: Pose, distance: float, turn: float
) -> None:
    result = towards(start, goal, distance, turn)
    assert math.dist(start.position, result.position) <= distance + 1e-12
    assert angle(start, result) <= turn + 1e-6
    assert math.dist(result.position, goal.position) <= math.dist(start.position, goal.position) + 1e-12
    assert angle(result, goal) <= angle(start, goal) + 1e-6
    assert math.hypot(*result.quaternion) == pytest.approx(1.0)


# --- the gain of speed


def test_stream_limits_acceleration_and_stops_at_once() -> None:
    limits = MotionLimits(SPEED)

    async def script(cell: Cell) -> None:
        await cell.link.ready()
        async with cell.link.motion(limits) as motion:
            await motion.to(displaced(5.0))
            await motion.settled()
            await motion.to(displaced(50.0))
            await cell.wait(0.1)
            motion.hold()
            cell.notices.append(str(len(cell.robot.setpoints)))
            await cell.wait(0.02)

    cell = run_cell(script)
    setpoints = cell.robot.setpoints
    hold_index = int(cell.notices[-1])
    speeds = [
        math.dist(a.position, b.position) / CYCLE for a, b in itertools.pairwise(setpoints[:hold_index])
    ]
    assert max(speeds) == pytest.approx(SPEED)
    steps = [after - before for before, after in itertools.pairwise(speeds)]
    assert max(map(abs, steps)) <= limits.acceleration * CYCLE + SLACK
    assert set(setpoints[hold_index:]) == {setpoints[hold_index]}  # held, without a braking distance
