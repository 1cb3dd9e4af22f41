"""Client and emulated controller of EGM together, with time set by the test: positions and queue."""

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
    """Controller whose datagrams are answered at once, on a network that may disturb them."""

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
            datagrams = network(list(self.robot.endpoint.data_to_send(self.now)))
            if datagrams:
                self.bridge.receive(datagrams, self.now)
            while (event := self.bridge.next_event()) is not None:
                if isinstance(event, StreamLost):
                    self.lost.append(event.text)
            self.robot.endpoint.receive(self.bridge.data_to_send(self.now), self.now)
        return self

    def moves_down(self) -> "Pair":
        """Begin a movement at 20 mm/s and run it for half a second."""
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


def test_egm_pair_follows_movement_within_delay() -> None:
    pair = Pair().moves_down()
    height = pair.true()[2]
    distance = 0.6 - height
    assert distance == pytest.approx(0.02 * (0.5 - 0.05), abs=1e-3)  # the delays of controller and arm
    assert pair.bridge.counters["packets"] == pair.bridge.counters["answers"]


def test_egm_pair_without_orders_does_not_move() -> None:
    assert Pair().cycles(500).true() == START.position


def test_egm_pair_stays_at_last_point_after_movement() -> None:
    pair = Pair().moves_down()
    pair.bridge.stay()
    pair.bridge.end()
    last = pair.cycles(500).true()
    assert pair.cycles(2500).true() == pytest.approx(last, abs=1e-7)
    assert pair.robot.session.state is State.GUIDING


@pytest.mark.parametrize("fault", ["motors-off", "program-stopped"])
def test_egm_pair_stays_stopped_after_operator_stop(fault: str) -> None:
    """The target is still below; with the last reference, the controller would go there."""
    pair = Pair().moves_down()
    pair.ledger.inject("robot", fault, pair.now, {"for_s": 1.5})
    pair.cycles(300)
    position = pair.true()
    pair.cycles(500)
    assert pair.robot.session.state is State.GUIDING
    assert pair.true() == pytest.approx(position, abs=1e-6)
    assert pair.bridge.faults.first
    pair.bridge.end()
    newest = pair.bridge.newest
    assert newest is not None
    pair.bridge.begin(newest.pose, LIMITS, pair.now)  # another movement moves it again
    pair.bridge.aim(BELOW, pair.now)
    assert pair.cycles(125).true()[2] < position[2] - 2e-3


@pytest.mark.parametrize("fault", ["program-restarted", "deaf"])
def test_egm_pair_new_session_ends_movement(fault: str) -> None:
    pair = Pair().moves_down()
    pair.ledger.inject(
        "wire" if fault == "deaf" else "robot", fault, pair.now, {"for_s": 1.5} if fault == "deaf" else {}
    )
    pair.cycles(500)
    position = pair.true()
    assert pair.cycles(1000).robot.session.state is State.GUIDING
    assert pair.true() == pytest.approx(position, abs=1e-6)
    assert not pair.bridge.moving


def test_egm_pair_silent_client_stops_within_speed_over_gain() -> None:
    pair = Pair().moves_down()
    last = pair.bridge._setpoint
    assert last is not None
    pair.cycles(1000, lambda data: [])
    assert 0.0 < last.position[2] - pair.true()[2] <= 0.02 / 5.0 + 1e-4


def test_egm_pair_stays_at_reference_after_client_ends() -> None:
    pair = Pair().moves_down()
    last = pair.bridge._setpoint
    assert last is not None
    pair.bridge.end()
    pair.robot.endpoint.receive(pair.bridge.data_to_send(pair.now), pair.now)
    pair.cycles(1000, lambda data: [])
    assert pair.true() == pytest.approx(last.position, abs=1e-4)


@pytest.mark.parametrize("disturbance", ["twice", "in pairs", "late"])
def test_egm_pair_queue_stays_short_on_bad_network(disturbance: str) -> None:
    """A surplus answer would stay in the queue, and delay all that follow."""
    kept: list[bytes] = []

    def network(data: list[bytes]) -> list[bytes]:
        if disturbance == "twice":
            return data * 2
        kept.extend(data)
        if disturbance == "in pairs" and len(kept) < 2:
            return []
        if disturbance == "late" and len(kept) < 3:
            return []
        delivered = kept[:] if disturbance == "in pairs" else [kept[0]]
        del kept[: len(delivered)]
        return delivered

    pair = Pair().cycles(10).cycles(500, network)
    assert max(pair.queued) <= 1


@pytest.mark.parametrize(
    ("fault", "parameters"),
    [
        ("lost", {"probability": 0.1}),
        ("twice", {"probability": 0.3, "way": "from"}),
        ("late", {"ms": 10.0}),
    ],
)
def test_egm_pair_bad_network_only_distorts_path(fault: str, parameters: dict[str, Any]) -> None:
    good, bad = Pair(), Pair()
    bad.ledger.inject("wire", fault, T0, parameters)
    heights = [pair.moves_down().true()[2] for pair in (good, bad)]
    assert heights[1] == pytest.approx(heights[0], abs=1.5e-3)


def test_egm_pair_duplicated_answers_fill_queue() -> None:
    """The controller takes one a cycle: 64 messages are a quarter of a second."""
    good, bad = Pair().moves_down(), Pair()
    bad.ledger.inject("wire", "twice", T0, {"probability": 1.0, "way": "to"})
    bad.moves_down()
    assert max(bad.queued) == 63  # 64, of which the cycle has taken one
    assert bad.true()[2] - good.true()[2] == pytest.approx(0.02 * 64 * CYCLE, abs=5e-4)


def test_egm_pair_feed_forward_removes_lag() -> None:
    behind = [
        0.6 - 0.02 * 0.5 - Pair(client).moves_down().true()[2]
        for client in (EgmClient(CYCLE), EgmClient(CYCLE, feed_forward=False))
    ]
    assert math.isclose(-behind[0], 0.02 * 0.05, abs_tol=3e-4)
    assert -behind[1] > 0.003


def test_egm_pair_reports_contain_current_measured_pose() -> None:
    pair = Pair().moves_down()
    pair.bridge.receive(list(pair.robot.endpoint.data_to_send(pair.now)), pair.now)
    newest = pair.bridge.newest
    assert newest is not None
    assert newest.pose.position == pytest.approx(pair.true(), abs=1e-12)


def test_egm_pair_ignores_strangers() -> None:
    """The stranger sends packets of a robot with its motors off, and noise; it receives nothing."""
    notices: list[str] = []
    received: list[Any] = []

    class Log(NullLog):
        def notice(self, kind: str, text: str) -> None:
            notices.append(text)

    async def main() -> None:
        clock, settings = Clock.running(), KindSettings(EgmSettings(), EgmProfile())
        async with AsyncExitStack() as stack:
            robot = EgmController(settings.emulated, StartPose(*START, tool_length=0.2), clock.now(), 7)
            serving = Serving(clock, stack, received.append, notices.append)
            assert ROBOT.emulation is not None
            address = await ROBOT.emulation.serve("udp+memory:egm", robot, settings, serving)
            link = await ROBOT.connect(address, settings, Wiring("robot", clock, Log()))
            stack.push_async_callback(link.aclose)
            link.start()
            report = await link.ready()
            assert report.pose.position == pytest.approx(START.position)
            stranger = await connect_datagrams(address, clock)
            stack.push_async_callback(stranger.aclose)
            stranger.start(received.append, lambda end: None)
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
    assert received == []
    assert [text for text in notices if "are refused" not in text] == []
    assert notices
