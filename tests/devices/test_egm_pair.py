"""Client and emulated controller of EGM together, in fed time: what stands still, and what the queue holds."""

import math
from collections.abc import Callable
from contextlib import AsyncExitStack
from typing import Any

import numpy as np
import pytest

from emulators.devices.egm import EGM_FAULTS, EgmController, EgmProfile, State
from emulators.faults import Ledger
from emulators.seams import StartPose
from hil_bridge.clock import Clock, run_virtual
from hil_bridge.devices.device_log import NullLog
from hil_bridge.devices.kinds import KindSettings
from hil_bridge.devices.robots.egm.room import ROBOT
from hil_bridge.devices.robots.egm.settings import EgmSettings
from hil_bridge.devices.robots.seam import MotionLimits
from hil_bridge.devices.robots.setpoint_responder import SetpointResponder
from hil_bridge.devices.wiring import Serving, Wiring
from hil_bridge.transports import connect_datagrams
from protocol.devices.egm import EgmClient, RobotMessage, RobotWare, encode_robot
from protocol.geometry import Pose
from protocol.robot import StreamLost

T0 = 1234.5
CYCLE = 0.004
DOWN = (0.0, 1.0, 0.0, 0.0)
START = Pose((0.9, -0.1, 0.6), DOWN)
BELOW = Pose((0.9, -0.1, 0.5), DOWN)
LIMITS = MotionLimits(0.02, hold_after=30.0, give_up_after=60.0)


class Pair:
    """A controller whose datagrams are answered at once, on a network that may do something to them."""

    def __init__(self, client: EgmClient | None = None, **settings: Any) -> None:
        self.robot = EgmController(EgmProfile(**settings), StartPose(*START, tool_length=0.2), T0, 7)
        self.bridge = SetpointResponder(client or EgmClient(CYCLE), CYCLE)
        self.ledger = Ledger(EGM_FAULTS)
        for target, handlers in self.robot.handlers.items():
            self.ledger.attach(target, handlers)
        self.now = T0
        self.queued: list[int] = []
        self.lost: list[str] = []

    def cycles(self, count: int, network: Callable[[list[bytes]], list[bytes]] = lambda data: data) -> "Pair":
        end = self.now + (count - 0.5) * CYCLE
        while self.now < end:
            deadline = self.robot.endpoint.next_deadline()
            assert deadline is not None
            self.now = deadline
            self.ledger.handle_deadline(self.now)
            self.robot.endpoint.handle_deadline(self.now)
            self.queued.append(len(self.robot.queue))
            told = network(list(self.robot.endpoint.data_to_send(self.now)))
            if told:
                self.bridge.receive(told, self.now)
            while (event := self.bridge.next_event()) is not None:
                if isinstance(event, StreamLost):
                    self.lost.append(event.text)
            self.robot.endpoint.receive(self.bridge.data_to_send(self.now), self.now)
        return self

    def moves_down(self) -> "Pair":
        """A movement at 20 mm/s, half a second old."""
        self.cycles(250)
        newest = self.bridge.newest
        assert newest is not None
        assert newest.fault == ""
        self.bridge.begin(newest.pose, LIMITS, self.now)
        self.bridge.aim(BELOW, self.now)
        return self.cycles(125)

    def true(self) -> tuple[float, float, float]:
        x, y, z = self.robot.path.trajectory(np.array([self.now]))[0][0].tolist()
        return x, y, z


def test_a_movement_is_followed_within_its_delay() -> None:
    pair = Pair().moves_down()
    height = pair.true()[2]
    way = 0.6 - height
    assert way == pytest.approx(0.02 * (0.5 - 0.05), abs=1e-3)  # the delays of controller and arm
    assert pair.bridge.counters["packets"] == pair.bridge.counters["answers"]


def test_before_anything_was_ordered_the_tool_stands_exactly_where_it_was() -> None:
    assert Pair().cycles(500).true() == START.position


def test_behind_a_movement_the_tool_stands_at_its_last_point_for_good() -> None:
    pair = Pair().moves_down()
    pair.bridge.stay()
    pair.bridge.end()
    last = pair.cycles(500).true()
    assert pair.cycles(2500).true() == pytest.approx(last, abs=1e-7)
    assert pair.robot.session.state is State.GUIDING


@pytest.mark.parametrize("fault", ["motors-off", "program-stopped"])
def test_a_stop_by_people_is_left_standing_also_when_the_guidance_goes_on(fault: str) -> None:
    """The target is still below; the controller would go there with the last reference."""
    pair = Pair().moves_down()
    pair.ledger.inject("robot", fault, pair.now, {"for_s": 1.5})
    pair.cycles(300)
    stood = pair.true()
    pair.cycles(500)
    assert pair.robot.session.state is State.GUIDING
    assert pair.true() == pytest.approx(stood, abs=1e-6)
    assert pair.bridge.faults.first
    pair.bridge.end()
    newest = pair.bridge.newest
    assert newest is not None
    pair.bridge.begin(newest.pose, LIMITS, pair.now)  # another movement moves it again
    pair.bridge.aim(BELOW, pair.now)
    assert pair.cycles(125).true()[2] < stood[2] - 2e-3


@pytest.mark.parametrize("fault", ["program-restarted", "deaf"])
def test_another_session_ends_the_movement_and_moves_nothing(fault: str) -> None:
    pair = Pair().moves_down()
    pair.ledger.inject(
        "wire" if fault == "deaf" else "robot", fault, pair.now, {"for_s": 1.5} if fault == "deaf" else {}
    )
    pair.cycles(500)
    stood = pair.true()
    assert pair.cycles(1000).robot.session.state is State.GUIDING
    assert pair.true() == pytest.approx(stood, abs=1e-6)
    assert not pair.bridge.moving


def test_a_bridge_that_falls_silent_on_its_way_leaves_the_tool_within_the_speed_over_the_gain() -> None:
    pair = Pair().moves_down()
    last = pair.bridge._setpoint
    assert last is not None
    pair.cycles(1000, lambda data: [])
    assert 0.0 < last.position[2] - pair.true()[2] <= 0.02 / 5.0 + 1e-4


def test_a_bridge_that_ends_its_movement_and_is_gone_leaves_the_tool_at_the_last_reference() -> None:
    pair = Pair().moves_down()
    last = pair.bridge._setpoint
    assert last is not None
    pair.bridge.end()
    pair.robot.endpoint.receive(pair.bridge.data_to_send(pair.now), pair.now)
    pair.cycles(1000, lambda data: [])
    assert pair.true() == pytest.approx(last.position, abs=1e-4)


@pytest.mark.parametrize("way", ["twice", "in pairs", "late"])
def test_the_queue_of_the_controller_stays_short_whatever_the_network_does(way: str) -> None:
    """One answer too many would stay in it, and delay all that follow."""
    kept: list[bytes] = []

    def network(data: list[bytes]) -> list[bytes]:
        if way == "twice":
            return data * 2
        kept.extend(data)
        if way == "in pairs" and len(kept) < 2:
            return []
        if way == "late" and len(kept) < 3:
            return []
        out = kept[:] if way == "in pairs" else [kept[0]]
        del kept[: len(out)]
        return out

    pair = Pair().cycles(10).cycles(500, network)
    assert max(pair.queued) <= 1


@pytest.mark.parametrize(
    ("fault", "given"),
    [
        ("lost", {"probability": 0.1}),
        ("twice", {"probability": 0.3, "way": "from"}),
        ("late", {"ms": 10.0}),
    ],
)
def test_a_bad_network_bends_the_way_but_does_not_break_it(fault: str, given: dict[str, Any]) -> None:
    good, bad = Pair(), Pair()
    bad.ledger.inject("wire", fault, T0, given)
    heights = [pair.moves_down().true()[2] for pair in (good, bad)]
    assert heights[1] == pytest.approx(heights[0], abs=1.5e-3)


def test_answers_that_a_network_doubles_fill_the_queue_and_delay_all_that_follow() -> None:
    """The controller takes one a cycle: 64 messages are a quarter of a second."""
    good, bad = Pair().moves_down(), Pair()
    bad.ledger.inject("wire", "twice", T0, {"probability": 1.0, "way": "to"})
    bad.moves_down()
    assert max(bad.queued) == 63  # 64, of which the cycle has taken one
    assert bad.true()[2] - good.true()[2] == pytest.approx(0.02 * 64 * CYCLE, abs=5e-4)


def test_feed_forward_takes_the_lag_of_the_gain_away() -> None:
    behind = [
        0.6 - 0.02 * 0.5 - Pair(client).moves_down().true()[2]
        for client in (EgmClient(CYCLE), EgmClient(CYCLE, feed_forward=False))
    ]
    assert math.isclose(-behind[0], 0.02 * 0.05, abs_tol=3e-4)
    assert -behind[1] > 0.003


def test_reports_tell_the_measured_pose_of_their_moment() -> None:
    pair = Pair().moves_down()
    pair.bridge.receive(list(pair.robot.endpoint.data_to_send(pair.now)), pair.now)
    newest = pair.bridge.newest
    assert newest is not None
    assert newest.pose.position == pytest.approx(pair.true(), abs=1e-12)


def test_a_stranger_on_the_port_neither_moves_the_robot_nor_stops_it() -> None:
    """It sends what a robot with its motors off would send, and noise; it hears nothing."""
    notices: list[str] = []
    heard: list[Any] = []

    class Log(NullLog):
        def notice(self, kind: str, text: str) -> None:
            notices.append(text)

    async def main() -> None:
        clock, settings = Clock.running(), KindSettings(EgmSettings(), EgmProfile())
        async with AsyncExitStack() as stack:
            robot = EgmController(settings.emulated, StartPose(*START, tool_length=0.2), clock.now(), 7)
            serving = Serving(clock, stack, heard.append, notices.append)
            assert ROBOT.emulation is not None
            address = await ROBOT.emulation.serve("udp+memory:egm", robot, settings, serving)
            link = await ROBOT.connect(address, settings, Wiring("robot", clock, Log()))
            stack.push_async_callback(link.aclose)
            link.start()
            report = await link.ready()
            assert report.pose.position == pytest.approx(START.position)
            stranger = await connect_datagrams(address, clock)
            stack.push_async_callback(stranger.aclose)
            stranger.start(heard.append, lambda end: None)
            hostile = [encode_robot(RobotMessage(9, 9), RobotWare.RW7), b"", b"\xff" * 60_000]
            async with link.motion(LIMITS) as motion:
                await motion.to(Pose((0.9, -0.1, 0.599), DOWN))
                for _ in range(100):
                    stranger.send(hostile)
                    await clock.sleep_until(clock.now() + CYCLE)
                await motion.settled()
            await clock.sleep_until(clock.now() + 2.0)
            report = await link.report()
            assert report.fault == ""
            assert report.pose.position == pytest.approx((0.9, -0.1, 0.599), abs=1e-5)

    run_virtual(main)
    assert heard == []
    assert [text for text in notices if "are refused" not in text] == []
    assert notices
