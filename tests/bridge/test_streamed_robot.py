"""The shell of robots that drive the cycle, with a small client and robot: all in virtual time."""

import asyncio
import itertools
import math
import struct
from collections import deque
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from hil_bridge.clock import Clock, Timer, run_virtual
from hil_bridge.devices.device_log import Silence
from hil_bridge.devices.robots.answering import Answering
from hil_bridge.devices.robots.seam import Motion, MotionLimits, Pacing, RobotFacts, RobotLink, Sent
from hil_bridge.devices.robots.streamed import SILENT_S, StreamedLink
from hil_bridge.errors import DeviceError, OrderRefused, Reason, TransportClosed
from hil_bridge.runs.leaving import WayOut
from hil_bridge.runs.setup import Setup
from hil_bridge.runs.small_steps import SmallSteps
from hil_bridge.settings.configuration import Config
from hil_bridge.transports import Datagrams, DatagramWire, connect_datagrams, listen_datagrams
from protocol.datagram import arrived_at
from protocol.geometry import Pose, towards
from protocol.robot import ReportReceived, RobotReport, StreamEvent, StreamLost

CYCLE = 0.004
SPEED = 0.05
DOWN = (0.0, 1.0, 0.0, 0.0)
START = Pose((0.9, -0.1, 0.6), DOWN)
AT_ONCE = 1e3
"""An acceleration that bounds nothing, m/s² or rad/s²: these tests are about speed, the last ones about its gain."""
LIMITS = MotionLimits(
    SPEED, hold_after=0.1, give_up_after=2.0, acceleration=AT_ONCE, turn_acceleration=AT_ONCE
)
FACTS = RobotFacts("toy", Pacing.STREAMED, cycle_s=CYCLE)
PACKET, ANSWER = struct.Struct("!Q7d?"), struct.Struct("!Q?7d")
SLACK = 1e-9


def moved(x_mm: float, z_mm: float = 0.0) -> Pose:
    (x, y, z), quaternion = START
    return Pose((x + x_mm * 1e-3, y, z + z_mm * 1e-3), quaternion)


class ToyClient:
    """Packs and unpacks, and nothing else: all that a third party's room needs beside its settings."""

    def __init__(self) -> None:
        self._events: deque[StreamEvent] = deque()
        self._asked: deque[int] = deque()
        self._answers: list[bytes] = []
        self.calls: list[str] = []

    def receive(self, data: Datagrams, now: float) -> None:
        for datagram in data:
            sequence, x, y, z, *quaternion, stopped = PACKET.unpack(datagram)
            at = arrived_at(datagram, now)
            fault = "protective stop; release it at the pendant" if stopped else ""
            w, i, j, k = quaternion
            pose = Pose((x, y, z), (w, i, j, k))
            self._asked.append(sequence)
            self._events.append(ReportReceived(RobotReport(sequence, pose, at, at, fault)))

    def next_event(self) -> StreamEvent | None:
        return self._events.popleft() if self._events else None

    def data_to_send(self, now: float) -> Datagrams:
        answers, self._answers = self._answers, []
        return answers

    def next_deadline(self) -> float | None:
        return None

    def handle_deadline(self, now: float) -> None:
        """There is none."""

    def begin(self, pose: Pose) -> None:
        self.calls.append("begin")

    def target(self, pose: Pose, now: float) -> None:
        self._answers.append(ANSWER.pack(self._asked.popleft(), True, *pose.position, *pose.quaternion))

    def hold(self, now: float) -> None:
        self._answers.append(ANSWER.pack(self._asked.popleft(), False, *START.position, *START.quaternion))

    def end(self) -> None:
        self.calls.append("end")


@dataclass
class ToyRobot:
    """Sends a packet each cycle, and goes at once where an answer tells it to."""

    wire: DatagramWire
    clock: Clock
    pose: Pose = START
    stopped: bool = False
    silent: bool = False
    told_off_mm: float = 0.0
    """It tells to be so much farther along x than it is."""
    sent: int = 0
    answers: list[tuple[float, int, bool, Pose]] = field(default_factory=list)
    """Each: when it came, to which packet, whether within a movement, the set point."""
    timer: Timer | None = None

    def start(self) -> None:
        self.wire.start(self._answered, lambda cause: None)
        self._begun_at = self.clock.now()
        self._beat()

    def _beat(self) -> None:
        if not self.silent:
            self.send()
        self._beats = getattr(self, "_beats", 0) + 1
        self.timer = self.clock.call_at(self._begun_at + self._beats * CYCLE, self._beat)

    def send(self) -> None:
        self.sent += 1
        (x, y, z), quaternion = self.pose
        place = x + self.told_off_mm * 1e-3, y, z
        self.wire.send([PACKET.pack(self.sent, *place, *quaternion, self.stopped)])

    def _answered(self, data: Datagrams) -> None:
        for datagram in data:
            sequence, moving, x, y, z, w, i, j, k = ANSWER.unpack(datagram)
            pose = Pose((x, y, z), (w, i, j, k))
            self.answers.append((self.clock.now(), sequence, moving, pose))
            if moving and not self.stopped:
                self.pose = pose

    @property
    def setpoints(self) -> list[Pose]:
        return [pose for _, _, moving, pose in self.answers if moving]


NO_SENSOR: Any = SimpleNamespace(newest=None, peaks=None, saturated=0, delay=0.0, check=lambda: None)


@dataclass
class Cell:
    """A link, its robot, and what the link told."""

    link: StreamedLink[Datagrams]
    robot: ToyRobot
    client: ToyClient
    clock: Clock
    notices: list[str]

    async def wait(self, seconds: float) -> None:
        await self.clock.sleep_until(self.clock.now() + seconds)


def run_cell(script: Callable[[Cell], Awaitable[None]], options: str = "", starts: bool = True) -> Cell:
    """Run a script with a link over a network in memory; `options` are of the robot's end."""
    kept: list[Cell] = []

    async def main() -> None:
        clock = Clock.running()
        listening = await listen_datagrams("udp+memory:robot", clock)
        robot = ToyRobot(await connect_datagrams(listening.address + options, clock), clock)
        notices: list[str] = []

        class Log(Silence):
            def notice(self, kind: str, text: str) -> None:
                notices.append(text)

        client = ToyClient()
        link = StreamedLink(listening.transport, client, FACTS, clock, Log())
        seam: RobotLink = link
        seam.start()
        if starts:
            robot.start()
        kept.append(Cell(link, robot, client, clock, notices))
        try:
            await script(kept[0])
        finally:
            await link.aclose()
            if robot.timer is not None:
                robot.timer.cancel()
            await robot.wire.aclose()

    run_virtual(main)
    return kept[0]


def check_bounded(setpoints: Sequence[Pose], limits: MotionLimits = LIMITS) -> None:
    for before, after in itertools.pairwise(setpoints):
        assert math.dist(before.position, after.position) <= limits.speed * CYCLE + SLACK
        assert angle(before, after) <= limits.turn_speed * CYCLE + 1e-7


def angle(one: Pose, other: Pose) -> float:
    cosine = sum(a * b for a, b in zip(one.quaternion, other.quaternion, strict=True))
    return 2.0 * math.acos(min(1.0, abs(cosine)))


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
    answering = Answering(client, CYCLE)
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
    assert cell.notices == ["no new target for 0.1 s: the robot is held on its way"]
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
        await cell.link.report()  # and the link goes on
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
        assert not cell.robot.answers[-1][2], "a movement goes on"
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
            with pytest.raises(OrderRefused, match="a movement is under way"):
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


# --- reports


def test_a_report_is_handed_out_once_while_fresh() -> None:
    async def script(cell: Cell) -> None:
        first = await cell.link.ready()
        again = await cell.link.report()
        assert again.sequence == first.sequence + 1
        assert cell.clock.now() == again.received_at == again.pose_at
        await cell.wait(0.02 + CYCLE / 2)  # a beat of a control period
        now = cell.clock.now()
        newest = await cell.link.report()
        assert (cell.clock.now(), newest.sequence) == (now, again.sequence + 5)
        assert now - newest.received_at == pytest.approx(CYCLE / 2)
        assert (await cell.link.report()).sequence == newest.sequence + 1
        await cell.wait(CYCLE / 2)
        cell.robot.silent = True
        await cell.wait(3 * CYCLE)
        cell.clock.call_at(cell.clock.now() + 0.1, cell.robot.send)
        old = cell.robot.sent
        assert (await cell.link.report()).sequence == old + 1, "an old report was handed out"

    run_cell(script)


def test_a_robot_that_does_not_speak_says_what_to_do() -> None:
    async def never(cell: Cell) -> None:
        with pytest.raises(DeviceError, match=r"robot on udp.* sent nothing for 10 s; start its program"):
            await cell.link.ready()

    async def no_more(cell: Cell) -> None:
        await cell.link.ready()
        async with cell.link.motion(LIMITS) as motion:
            cell.robot.silent = True
            await cell.wait(SILENT_S + CYCLE)
            with pytest.raises(DeviceError, match=r"sent nothing for 0\.5 s; see whether its program"):
                await motion.to(moved(1.0))
            with pytest.raises(DeviceError, match=r"sent nothing for 0\.5 s; see whether its program"):
                await cell.link.report()
            assert not motion.ordered
            cell.robot.silent = False
            await cell.link.report()
            await motion.to(moved(1.0))

    run_cell(never, starts=False)
    assert run_cell(no_more).robot.pose == moved(1.0)


def test_a_lossy_network_costs_time_and_nothing_else() -> None:
    async def script(cell: Cell) -> None:
        await cell.link.ready()
        async with cell.link.motion(LIMITS) as motion:
            for number in range(40):
                await motion.to(moved(0.2 * number))
                await cell.wait(0.02)
            await motion.to(moved(4.0))
            await motion.settled()
        sent, arrived = cell.robot.sent, cell.link.counters["packets"]
        assert 0.5 * sent < arrived < sent
        assert cell.link.counters["answers"] == arrived
        assert cell.link.counters["packets missing"] > 0 < cell.link.counters["stale packets"]

    cell = run_cell(script, "?latency_ms=1&jitter_ms=2&loss=0.2&reorder=0.2&duplicate=0.1&seed=3")
    in_order = [
        pose
        for _, pose in sorted(
            {sequence: pose for _, sequence, moving, pose in cell.robot.answers if moving}.items()
        )
    ]
    assert moved(4.0) == in_order[-1]
    for before, after in itertools.pairwise(cell.robot.setpoints):
        assert math.dist(before.position, after.position) <= 40 * SPEED * CYCLE


def test_packets_that_were_held_up_and_come_together_make_one_step() -> None:
    answering = Answering(ToyClient(), CYCLE)
    answering.begin(START, LIMITS, 1000.0)
    answering.aim(moved(10.0), 1000.0)
    answering.receive(
        [PACKET.pack(k, *START.position, *DOWN, False) for k in range(1, 21)], 1000.0 + 20 * CYCLE
    )
    answers = [ANSWER.unpack(answer)[2] for answer in answering.data_to_send(1000.0 + 20 * CYCLE)]
    assert answers == [pytest.approx(START.position[0] + SPEED * CYCLE)] * 20


def test_a_packet_that_comes_again_is_answered_as_before() -> None:
    answering = Answering(ToyClient(), CYCLE)
    answering.begin(START, LIMITS, 1000.0)
    answering.aim(moved(10.0), 1000.0)
    answers = []
    for number, at in ((5, CYCLE), (5, 2 * CYCLE), (4, 3 * CYCLE), (6, 4 * CYCLE)):
        answering.receive([PACKET.pack(number, *START.position, *DOWN, False)], 1000.0 + at)
        answers += [ANSWER.unpack(answer)[2] for answer in answering.data_to_send(1000.0 + at)]
    assert answers[0] == answers[1] == answers[2] < answers[3]
    assert answering.counters["stale packets"] == 2


def test_an_answer_that_comes_later_than_a_cycle_is_counted() -> None:
    answering = Answering(ToyClient(), CYCLE)

    class Late(bytes):
        received_at = 1000.0

    for number, late_by in ((1, 1.5), (2, 0.5)):
        now = 1000.0 + late_by * CYCLE
        answering.receive([Late(PACKET.pack(number, *START.position, *DOWN, False))], now)
        assert len(answering.data_to_send(now)) == 1
    assert answering.counters["late answers"] == 1
    packets = [Late(PACKET.pack(number, *START.position, *DOWN, False)) for number in (3, 4, 5)]
    answering.receive(packets, 1001.0)
    answering.data_to_send(1001.0)
    assert answering.counters["late answers"] == 4, "packets that were held up together were each late"


def test_what_the_robot_ends_itself_is_told_in_its_words() -> None:
    async def script(cell: Cell) -> None:
        await cell.link.ready()
        async with cell.link.motion(LIMITS) as motion:
            await motion.to(moved(100.0))
            cell.client._events.append(StreamLost("its program ended; start it again"))
            with pytest.raises(DeviceError, match=r"robot on .*: its program ended; start it again"):
                await cell.link._next_packet()
            with pytest.raises(
                DeviceError, match="its program ended; start it again; begin another movement"
            ):
                await motion.to(moved(0.0))
            motion.abandon()

    cell = run_cell(script)
    assert cell.client.calls == ["begin", "end"]
    assert cell.notices == ["robot on udp+memory:robot: its program ended; start it again"]


def test_a_wire_that_is_closed_ends_all_waiting() -> None:
    async def script(cell: Cell) -> None:
        await cell.link.ready()

        async def run() -> None:
            async with cell.link.motion(LIMITS) as motion:
                cell.robot.silent = True
                waiting = asyncio.create_task(cell.link._next_packet())
                await cell.wait(0.01)
                await cell.link.aclose()
                with pytest.raises(TransportClosed):
                    await waiting
                with pytest.raises(TransportClosed):
                    await motion.to(moved(1.0))
                await cell.link.report()

        with pytest.raises(TransportClosed):
            await run()

    assert run_cell(script).client.calls == ["begin", "end"]


def test_a_robot_without_a_cycle_cannot_stream() -> None:
    async def main() -> None:
        clock = Clock.running()
        wire = (await listen_datagrams("udp+memory:robot", clock)).transport
        with pytest.raises(ValueError, match="toy: a robot that streams has a cycle"):
            StreamedLink(wire, ToyClient(), RobotFacts("toy", Pacing.STREAMED), clock, Silence())
        await wire.aclose()

    run_virtual(main)


# --- what a run makes of it


def test_a_small_step_is_waited_for_until_it_is_reported() -> None:
    async def script(cell: Cell) -> None:
        await cell.link.ready()
        steps = SmallSteps(cell.clock, cell.link, NO_SENSOR)
        async with cell.link.motion(MotionLimits(0.002, hold_after=0.1)) as motion:
            began = cell.clock.now()
            report = await steps.to(motion, moved(0.5).position, DOWN, 0.5e-3)
            assert cell.clock.now() - began == pytest.approx(0.25, abs=6 * CYCLE)
            assert report.pose == cell.robot.pose == moved(0.5)

    run_cell(script)


def test_a_tool_is_retracted_only_where_the_robot_tells_so() -> None:
    rests: list[tuple[float, float]] = []

    async def script(cell: Cell) -> None:
        await cell.link.ready()
        config = Config()
        way_out = WayOut(config, cell.clock, cell.link, NO_SENSOR, Setup(config).loop)
        rests.append(await way_out.rest(START.position, START.position, True))
        rests.append(await way_out.rest(START.position, START.position, False))
        cell.robot.silent = True
        await cell.wait(3 * CYCLE)
        rests.append(await way_out.rest(START.position, START.position, True))

    run_cell(script)
    told, unasked, silent = (depth for depth, _ in rests)
    assert told == 0.0
    assert math.isnan(unasked)
    assert math.isnan(silent)


def test_a_retraction_is_judged_again_after_each_step() -> None:
    async def script(cell: Cell) -> None:
        await cell.link.ready()
        config, blamed = Config(), list[Reason]()
        state = Setup(config).loop.initial(START.position)
        deep = replace(state.supervisor, depth=0.01, position=moved(0.0, -10.0).position)
        cell.robot.pose = Pose(deep.position, DOWN)
        await cell.wait(2 * CYCLE)
        async with cell.link.motion(LIMITS) as motion:
            ordered: list[Pose] = []

            class Noted:
                halted = False

                async def to(self, target: Pose, *, soon: bool = False) -> Sent:
                    given = cell.robot.setpoints[-1:] or [cell.robot.pose]
                    assert not ordered or given[0] == ordered[-1], "the way before was not over"
                    ordered.append(target)
                    return await motion.to(target, soon=soon)

                async def settled(self) -> None:
                    await motion.settled()

                def __getattr__(self, name: str) -> Any:
                    return getattr(motion, name)

            way_out = WayOut(config, cell.clock, cell.link, NO_SENSOR, Setup(config).loop)
            await way_out.retract(Noted(), replace(state, supervisor=deep), DOWN, blamed.append)
        assert len(ordered) > 2

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
