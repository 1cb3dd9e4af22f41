"""Reports of a robot that drives the cycle, over any network, and their use by a run."""

import asyncio
import itertools
import math
from types import SimpleNamespace
from typing import Any

import pytest
from msgspec.structs import replace

from hil_bridge.clock import Clock, run_virtual
from hil_bridge.devices.device_log import NullLog
from hil_bridge.devices.robots.seam import MotionLimits, Pacing, RobotFacts, Sent
from hil_bridge.devices.robots.setpoint_responder import SetpointResponder
from hil_bridge.devices.robots.streamed import SILENT_S, StreamedLink
from hil_bridge.errors import DeviceError, Reason, TransportClosed
from hil_bridge.runs.retreat import FallbackRetraction
from hil_bridge.runs.setup import Setup
from hil_bridge.runs.small_steps import SmallSteps
from hil_bridge.settings.configuration import Config
from hil_bridge.transports import listen_datagrams
from protocol.geometry import Pose
from protocol.robot import StreamLost
from tests.devices.streamed_toy import (
    ANSWER,
    CYCLE,
    DOWN,
    LIMITS,
    PACKET,
    SPEED,
    START,
    Cell,
    ToyClient,
    displaced,
    run_cell,
)

NO_SENSOR: Any = SimpleNamespace(
    newest=None, newest_at=math.nan, peaks=None, saturated=0, delay=0.0, check=lambda: None
)


# --- reports


def test_stream_report_is_returned_once_while_fresh() -> None:
    async def script(cell: Cell) -> None:
        first = await cell.link.ready()
        again = await cell.link.report()
        assert again.sequence == first.sequence + 1
        assert cell.clock.now() == again.received_at == again.pose_at
        await cell.wait(0.02 + CYCLE / 2)  # one control period
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
        assert (await cell.link.report()).sequence == old + 1, "an old report was returned"

    run_cell(script)


def test_stream_silent_robot_reports_remedy() -> None:
    async def never(cell: Cell) -> None:
        with pytest.raises(DeviceError, match=r"robot on udp.* sent nothing for 10 s; start its program"):
            await cell.link.ready()

    async def no_more(cell: Cell) -> None:
        await cell.link.ready()
        async with cell.link.motion(LIMITS) as motion:
            cell.robot.silent = True
            await cell.wait(SILENT_S + CYCLE)
            with pytest.raises(DeviceError, match=r"sent nothing for 0\.5 s; check that its program"):
                await motion.to(displaced(1.0))
            with pytest.raises(DeviceError, match=r"sent nothing for 0\.5 s; check that its program"):
                await cell.link.report()
            assert not motion.ordered
            cell.robot.silent = False
            await cell.link.report()
            await motion.to(displaced(1.0))

    run_cell(never, starts=False)
    assert run_cell(no_more).robot.pose == displaced(1.0)


def test_stream_on_lossy_network_only_takes_longer() -> None:
    async def script(cell: Cell) -> None:
        await cell.link.ready()
        async with cell.link.motion(LIMITS) as motion:
            for number in range(40):
                await motion.to(displaced(0.2 * number))
                await cell.wait(0.02)
            await motion.to(displaced(4.0))
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
    assert displaced(4.0) == in_order[-1]
    for before, after in itertools.pairwise(cell.robot.setpoints):
        assert math.dist(before.position, after.position) <= 40 * SPEED * CYCLE


def test_stream_delayed_packets_cause_single_step() -> None:
    answering = SetpointResponder(ToyClient(), CYCLE)
    answering.begin(START, LIMITS, 1000.0)
    answering.aim(displaced(10.0), 1000.0)
    answering.receive(
        [PACKET.pack(k, *START.position, *DOWN, False) for k in range(1, 21)], 1000.0 + 20 * CYCLE
    )
    answers = [ANSWER.unpack(answer)[2] for answer in answering.data_to_send(1000.0 + 20 * CYCLE)]
    assert answers == [pytest.approx(START.position[0] + SPEED * CYCLE)] * 20


def test_stream_duplicate_packet_gets_same_answer() -> None:
    answering = SetpointResponder(ToyClient(), CYCLE)
    answering.begin(START, LIMITS, 1000.0)
    answering.aim(displaced(10.0), 1000.0)
    answers = []
    for number, at in ((5, CYCLE), (5, 2 * CYCLE), (4, 3 * CYCLE), (6, 4 * CYCLE)):
        answering.receive([PACKET.pack(number, *START.position, *DOWN, False)], 1000.0 + at)
        answers += [ANSWER.unpack(answer)[2] for answer in answering.data_to_send(1000.0 + at)]
    assert answers[0] == answers[1] == answers[2] < answers[3]
    assert answering.counters["stale packets"] == 2


def test_stream_late_answer_is_counted() -> None:
    answering = SetpointResponder(ToyClient(), CYCLE)

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
    assert answering.counters["late answers"] == 4, "each packet that was delayed with others is late"


def test_stream_end_by_robot_is_reported() -> None:
    async def script(cell: Cell) -> None:
        await cell.link.ready()
        async with cell.link.motion(LIMITS) as motion:
            await motion.to(displaced(100.0))
            cell.client._events.append(StreamLost("its program ended; start it again"))
            with pytest.raises(DeviceError, match=r"robot on .*: its program ended; start it again"):
                await cell.link._next_packet()
            with pytest.raises(
                DeviceError, match="its program ended; start it again; begin another movement"
            ):
                await motion.to(displaced(0.0))
            motion.abandon()

    cell = run_cell(script)
    assert cell.client.calls == ["begin", "end"]
    assert cell.notices == ["robot on udp+memory:robot: its program ended; start it again"]


def test_stream_closed_wire_ends_pending_waits() -> None:
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
                    await motion.to(displaced(1.0))
                await cell.link.report()

        with pytest.raises(TransportClosed):
            await run()

    assert run_cell(script).client.calls == ["begin", "end"]


def test_stream_without_cycle_is_refused() -> None:
    async def main() -> None:
        clock = Clock.running()
        wire = (await listen_datagrams("udp+memory:robot", clock)).transport
        with pytest.raises(ValueError, match="toy: a streaming robot needs a cycle"):
            StreamedLink(wire, ToyClient(), RobotFacts("toy", Pacing.STREAMED), clock, NullLog())
        await wire.aclose()

    run_virtual(main)


# --- what a run makes of it


def test_stream_small_step_waits_for_report() -> None:
    async def script(cell: Cell) -> None:
        await cell.link.ready()
        steps = SmallSteps(cell.clock, cell.link, NO_SENSOR)
        async with cell.link.motion(MotionLimits(0.002, hold_after=0.1)) as motion:
            began = cell.clock.now()
            report = await steps.to(motion, displaced(0.5).position, DOWN, 0.5e-3)
            assert cell.clock.now() - began == pytest.approx(0.25, abs=6 * CYCLE)
            assert report.pose == cell.robot.pose == displaced(0.5)

    run_cell(script)


def test_stream_retraction_needs_reported_position() -> None:
    rests: list[tuple[float, float]] = []

    async def script(cell: Cell) -> None:
        await cell.link.ready()
        config = Config()
        fallback = FallbackRetraction(config, cell.clock, cell.link, NO_SENSOR, Setup(config).loop)
        rests.append(await fallback.rest(START.position, START.position, True))
        rests.append(await fallback.rest(START.position, START.position, False))
        cell.robot.silent = True
        await cell.wait(3 * CYCLE)
        rests.append(await fallback.rest(START.position, START.position, True))

    run_cell(script)
    reported, unasked, silent = (depth for depth, _ in rests)
    assert reported == 0.0
    assert math.isnan(unasked)
    assert math.isnan(silent)


def test_stream_retraction_is_checked_after_each_step() -> None:
    async def script(cell: Cell) -> None:
        await cell.link.ready()
        config, blamed = Config(), list[Reason]()
        state = Setup(config).loop.initial(START.position)
        deep = replace(state.supervisor, depth=0.01, position=displaced(0.0, -10.0).position)
        cell.robot.pose = Pose(deep.position, DOWN)
        await cell.wait(2 * CYCLE)
        async with cell.link.motion(LIMITS) as motion:
            ordered: list[Pose] = []

            class Noted:
                halted = False

                async def to(self, target: Pose, *, soon: bool = False) -> Sent:
                    reached = cell.robot.setpoints[-1:] or [cell.robot.pose]
                    assert not ordered or reached[0] == ordered[-1], "the previous movement had not ended"
                    ordered.append(target)
                    return await motion.to(target, soon=soon)

                async def settled(self) -> None:
                    await motion.settled()

                def __getattr__(self, name: str) -> Any:
                    return getattr(motion, name)

            fallback = FallbackRetraction(config, cell.clock, cell.link, NO_SENSOR, Setup(config).loop)
            await fallback.retract(Noted(), replace(state, supervisor=deep), DOWN, blamed.append)
        assert len(ordered) > 2

    run_cell(script)
