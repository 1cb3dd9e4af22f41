"""Small robot that drives the cycle, its client, and a link between them, in virtual time."""

import itertools
import math
import struct
from collections import deque
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, field

from hil_bridge.clock import Clock, Timer, run_virtual
from hil_bridge.devices.device_log import NullLog
from hil_bridge.devices.robots.seam import MotionLimits, Pacing, RobotFacts, RobotLink
from hil_bridge.devices.robots.streamed import StreamedLink
from hil_bridge.transports import Datagrams, DatagramWire, connect_datagrams, listen_datagrams
from protocol.datagram import arrived_at
from protocol.geometry import Pose
from protocol.robot import ReportReceived, RobotReport, StreamEvent

CYCLE = 0.004
SPEED = 0.05
DOWN = (0.0, 1.0, 0.0, 0.0)
START = Pose((0.9, -0.1, 0.6), DOWN)
AT_ONCE = 1e3
"""Acceleration without effect, m/s² or rad/s². The test of the acceleration uses the default one."""
LIMITS = MotionLimits(
    SPEED, hold_after=0.1, give_up_after=2.0, acceleration=AT_ONCE, turn_acceleration=AT_ONCE
)
FACTS = RobotFacts("toy", Pacing.STREAMED, cycle_s=CYCLE)
PACKET, ANSWER = struct.Struct("!Q7d?"), struct.Struct("!Q?7d")
SLACK = 1e-9


def displaced(x_mm: float, z_mm: float = 0.0) -> Pose:
    (x, y, z), quaternion = START
    return Pose((x + x_mm * 1e-3, y, z + z_mm * 1e-3), quaternion)


class ToyClient:
    """Client that only packs and unpacks: all that a plug-in's device package needs in addition to its settings."""

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
        """Do nothing: there is no deadline."""

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
    """Robot that sends a packet each cycle, and adopts the set point of an answer at once."""

    wire: DatagramWire
    clock: Clock
    pose: Pose = START
    stopped: bool = False
    silent: bool = False
    reported_offset_mm: float = 0.0
    """Offset of the reported position from the true one along x, mm."""
    sent: int = 0
    answers: list[tuple[float, int, bool, Pose]] = field(default_factory=list)
    """Arrival, number of the packet, whether in a movement, and set point of each answer."""
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
        position = x + self.reported_offset_mm * 1e-3, y, z
        self.wire.send([PACKET.pack(self.sent, *position, *quaternion, self.stopped)])

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


@dataclass
class Cell:
    """Link, its robot, and the notices of the link."""

    link: StreamedLink[Datagrams]
    robot: ToyRobot
    client: ToyClient
    clock: Clock
    notices: list[str]

    async def wait(self, seconds: float) -> None:
        await self.clock.sleep_until(self.clock.now() + seconds)


def run_cell(script: Callable[[Cell], Awaitable[None]], options: str = "", starts: bool = True) -> Cell:
    """Run a script with a link over a network in memory; `options` are of the robot's end."""
    cells: list[Cell] = []

    async def main() -> None:
        clock = Clock.running()
        listening = await listen_datagrams("udp+memory:robot", clock)
        robot = ToyRobot(await connect_datagrams(listening.address + options, clock), clock)
        notices: list[str] = []

        class Log(NullLog):
            def notice(self, kind: str, text: str) -> None:
                notices.append(text)

        client = ToyClient()
        link = StreamedLink(listening.transport, client, FACTS, clock, Log())
        seam: RobotLink = link
        seam.start()
        if starts:
            robot.start()
        cells.append(Cell(link, robot, client, clock, notices))
        try:
            await script(cells[0])
        finally:
            await link.aclose()
            if robot.timer is not None:
                robot.timer.cancel()
            await robot.wire.aclose()

    run_virtual(main)
    return cells[0]


def check_bounded(setpoints: Sequence[Pose], limits: MotionLimits = LIMITS) -> None:
    for before, after in itertools.pairwise(setpoints):
        assert math.dist(before.position, after.position) <= limits.speed * CYCLE + SLACK
        assert angle(before, after) <= limits.turn_speed * CYCLE + 1e-7


def angle(one: Pose, other: Pose) -> float:
    cosine = sum(a * b for a, b in zip(one.quaternion, other.quaternion, strict=True))
    return 2.0 * math.acos(min(1.0, abs(cosine)))
