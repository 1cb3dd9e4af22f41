"""Tests of RSI client and controller over a bad network: set point and robot stay together despite losses."""

from dataclasses import dataclass, field
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emulators.devices.rsi import RsiController, RsiProfile
from emulators.devices.rsi.session import State
from emulators.seams import StartPose
from protocol.devices.rsi import RsiClient, RsiLink
from protocol.geometry import Pose
from protocol.robot import ReportReceived, StreamLost

T0 = 1000.0
START = Pose((0.6, 0.0, 0.5), (0.0, 1.0, 0.0, 0.0))
STEP_MM = 0.1


@dataclass
class Pair:
    """Client that steers down by at most 0.1 mm per cycle, and its controller."""

    mode: Any = "relative"
    channel: Any = "pose"
    goal_mm: float = -8.0
    at_mm: float = 0.0
    """Set point, mm."""
    lost: bool = False
    corrections: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        profile = RsiProfile(mode=self.mode, move_after_ms=0.0, restart_s=0.0)
        self.robot = RsiController(profile, StartPose(*START), T0)
        self.client = RsiClient(RsiLink(mode=self.mode, correction=self.channel))
        self.began = False
        self.newest = 0
        self.now = T0

    @property
    def down_mm(self) -> float:
        """Return the height of the ordered pose above the start, mm."""
        return (self.robot.ordered_pose.position[2] - START.position[2]) * 1e3

    def cycle(self, telegrams: int = 1, answers: int = 1, late: bool = False) -> None:
        """Run one cycle, with these numbers of copies of the telegram and of the answer; a late answer comes in the
        next cycle.
        """
        due = self.robot.endpoint.next_deadline()
        assert due is not None
        self.robot.endpoint.handle_deadline(due)
        self.now = due
        self.corrections.append(self.down_mm)
        replies: list[bytes] = []
        for telegram in self.robot.endpoint.data_to_send(due):
            for _ in range(telegrams):
                replies += self.answered(telegram)
        if late:
            self.robot.endpoint.handle_deadline(due)  # not due: nothing happens
            self.late = replies
            return
        for reply in [*getattr(self, "late", []), *replies]:
            self.robot.endpoint.receive([reply] * answers, due + 0.001)
        self.late = []

    def answered(self, telegram: bytes) -> list[bytes]:
        self.client.receive([telegram], self.now)
        while (event := self.client.next_event()) is not None:
            if isinstance(event, StreamLost):
                self.lost = True
                self.began = False
            elif isinstance(event, ReportReceived):
                if not self.began:
                    self.client.hold(self.now)
                    self.began, self.newest = True, event.report.sequence
                    self.client.begin(START)
                    continue
                if not event.report.fault and event.report.sequence > self.newest:
                    self.newest = event.report.sequence
                    remaining = self.goal_mm - self.at_mm
                    self.at_mm += max(-STEP_MM, min(STEP_MM, remaining))
                self.client.target(Pose((0.6, 0.0, 0.5 + self.at_mm * 1e-3), START.quaternion), self.now)
        return list(self.client.data_to_send(self.now))


CHANNELS = pytest.mark.parametrize("channel", ["pose", "axes"])
MODES = pytest.mark.parametrize("mode", ["relative", "absolute"])


@CHANNELS
@MODES
def test_robot_follows_set_point_one_cycle_later(mode: str, channel: str) -> None:
    pair = Pair(mode, channel)
    before = 0.0
    for _ in range(100):
        pair.cycle()
        assert pair.down_mm == pytest.approx(before, abs=2e-5)
        before = pair.at_mm
    assert pair.down_mm == pytest.approx(-8.0, abs=2e-5)
    assert pair.robot.late == 0


COPIES = st.sampled_from([1, 1, 1, 1, 0, 2, 3])


@pytest.mark.full
@settings(max_examples=30)
@given(
    st.sampled_from(["relative", "absolute"]),
    st.sampled_from(["pose", "axes"]),
    st.lists(st.tuples(COPIES, COPIES, st.sampled_from([False, False, False, True])), max_size=80),
)
def test_bad_network_causes_no_overshoot(
    mode: str, channel: str, course: list[tuple[int, int, bool]]
) -> None:
    pair = Pair(mode, channel)
    for telegrams, answers, late in course:
        pair.cycle(telegrams, answers, late)
        assert pair.at_mm - 1e-4 <= pair.down_mm <= 2e-5, "it went farther than the set point"
    for _ in range(250):
        pair.cycle()
    assert not pair.lost
    assert pair.robot.state is State.MOVECORR
    assert pair.down_mm == pytest.approx(-8.0, abs=1e-3)
    steps = [after - before for before, after in zip(pair.corrections, pair.corrections[1:], strict=False)]
    assert min(steps) >= -STEP_MM - 0.04 - 1e-5  # its own way, and RsiLink.catch_up_mm_s in a cycle
    assert max(steps) <= 1e-5, "it went back and forth"


@CHANNELS
@MODES
def test_silent_client_leaves_robot_in_place(mode: str, channel: str) -> None:
    pair = Pair(mode, channel)
    for _ in range(30):
        pair.cycle()
    for _ in range(102):
        pair.cycle(answers=0)
    after = pair.down_mm
    assert after == pytest.approx(-2.9, abs=2e-5)
    assert pair.robot.state is State.ERROR
    assert pair.at_mm == pytest.approx(-2.9 - 0.1 * RsiLink().late_max, abs=0.15)  # and its set point waits
