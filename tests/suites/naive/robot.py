"""Robot link by EGM, implemented from the interface alone: it shares only the codec with the built-in link."""

import asyncio
import math
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from typing import Any

from emulators.devices.egm import EGM_FAULTS, EgmController, EgmProfile
from hil_bridge import DeviceError, OrderRefused, TransportError
from hil_bridge.devices.kinds import KindSettings, RobotEmulation, RobotKind
from hil_bridge.devices.robots.seam import MotionLimits, Pacing, RobotFacts, RobotReport, Sent
from protocol.devices.egm.messages import (
    Guidance,
    Motors,
    PoseMm,
    Rapid,
    RobotMessage,
    SensorMessage,
    decode_robot,
    encode_answer,
)
from protocol.endpoint import RemoteProtocolError
from protocol.geometry import Pose, Vector
from protocol.robot import pose_fault

MISTAKES = ("stop", "commanded", "stale", "leak", "mm", "halt", "nowhere", "waits", "task", "sign")
CYCLE_S = 0.004
SILENT_S = 0.5
FACTS = RobotFacts("naive EGM", Pacing.STREAMED, cycle_s=CYCLE_S)


@dataclass(frozen=True)
class NaiveSettings:
    mistake: str = ""


def to_pose(pose: PoseMm) -> Pose:
    x, y, z = (one / 1000.0 for one in pose.position_mm)
    return Pose((x, y, z), pose.quaternion)


def fault_of(message: RobotMessage) -> str:
    if message.motors != Motors.ON:
        return "the motors are off; switch them on"
    if message.rapid not in (Rapid.RUNNING, Rapid.UNDEFINED):
        return "the program stands; start it"
    if message.guidance != Guidance.RUNNING:
        return "it is not guided; start the program"
    if message.feedback is None or message.feedback.pose is None:
        return "it reports no pose"
    wrong = pose_fault(to_pose(message.feedback.pose))
    return f"it tells {wrong}" if wrong else ""


class NaiveMotion:
    def __init__(self, link: "NaiveLink", limits: MotionLimits) -> None:
        self._link, self.speed = link, limits.speed
        self.target: Pose | None = None
        self.stopped = ""
        self.halted = self.abandoned = False

    @property
    def ordered(self) -> bool:
        return self.target is not None

    @property
    def commanded(self) -> Vector | None:
        return None if self.target is None else self.target.position

    def _check(self) -> None:
        self._link.check()
        if self.halted or self.abandoned or self._link.motion_now is not self:
            raise OrderRefused("the movement is over")
        if self.stopped:
            raise OrderRefused(self.stopped)

    async def to(self, target: Pose, *, soon: bool = False) -> Sent:
        self._check()
        if (wrong := pose_fault(target)) and self._link.mistake != "nowhere":
            raise OrderRefused(f"not sent to {wrong}")
        self.target = target
        return Sent(self._link.clock.now())

    async def settled(self) -> None:
        while self.target is not None and not self.halted and self._link.set_point != self.target:
            self._check()
            await self._link.next_packet()
        self._check()

    def hold(self) -> None:
        self.target = self._link.set_point if self.target is not None else None

    async def halt(self) -> Sent:
        if self._link.mistake != "halt":
            self.hold()
        self.halted = True
        return Sent(self._link.clock.now())

    def abandon(self) -> None:
        self.hold()
        self.abandoned = True


class NaiveLink:
    facts = FACTS
    counters: Mapping[str, int] = {}

    def __init__(self, wire: Any, clock: Any, mistake: str) -> None:
        self.name, self.clock = wire.name, clock
        self._wire, self.mistake = wire, mistake
        self._seqno: int | None = None
        self._tm = self._own = self._numbers = 0
        self.newest: RobotReport = RobotReport(0, Pose((0.0,) * 3, (1.0, 0.0, 0.0, 0.0)), 0.0, -math.inf)
        self._handed_out = True
        self.set_point: Pose | None = None
        self.motion_now: NaiveMotion | None = None
        self._waiting: set[asyncio.Future[None]] = set()
        self._ended: Exception | None = None

    def start(self) -> None:
        if self.mistake == "task":
            self.watch = asyncio.get_running_loop().create_task(asyncio.sleep(5.0), name="watchdog")
        self._wire.start(self._arrived, self._over)

    async def aclose(self) -> None:
        if self.mistake == "leak":
            await self.clock.sleep_until(self.clock.now() + 0.01)  # the last answer shall go out
            await self._wire.aclose()
            return
        try:
            await self.clock.sleep_until(self.clock.now() + 0.01)
        finally:
            await self._wire.aclose()

    # --- packets

    def _arrived(self, datagrams: Any) -> None:
        for datagram in datagrams:
            try:
                message = decode_robot(bytes(datagram))
            except RemoteProtocolError:
                continue
            old = self._seqno is not None and message.tm_ms <= self._tm
            if old and self.mistake != "stale":
                continue
            self._seqno, self._tm = message.seqno, message.tm_ms
            self._take(message)

    def _take(self, message: RobotMessage) -> None:
        now, fault = self.clock.now(), fault_of(message)
        reported = message.feedback.pose if message.feedback is not None else None
        pose = self.newest.pose if reported is None else to_pose(reported)
        if self.mistake == "mm" and reported is not None:
            pose = Pose(reported.position_mm, reported.quaternion)
        if self.mistake == "sign":
            w, i, j, k = pose.quaternion
            pose = Pose(pose.position, (w, -i, -j, -k))
        motion = self.motion_now
        if self.mistake == "commanded" and motion is not None and motion.target is not None:
            pose = motion.target
        self._numbers += 1
        self.newest, self._handed_out = RobotReport(self._numbers, pose, now, now, fault), False
        if motion is not None and fault:
            motion.stopped = motion.stopped or fault
        self._step(motion, message, fault)
        for waiting in self._waiting:
            if not waiting.done():
                waiting.set_result(None)

    def _step(self, motion: NaiveMotion | None, message: RobotMessage, fault: str) -> None:
        planned = message.planned.pose if message.planned is not None else None
        stays = planned or (message.feedback.pose if message.feedback is not None else None)
        stopped = fault or (motion is not None and motion.stopped)
        if self.set_point is None or (stopped and self.mistake != "stop"):
            if stays is None or pose_fault(to_pose(stays)):
                return
            self.set_point = to_pose(stays)
        if motion is not None and motion.target is not None and (not stopped or self.mistake == "stop"):
            self.set_point = nearer(self.set_point, motion.target, motion.speed * CYCLE_S)
        x, y, z = self.set_point.position
        reference = PoseMm((x * 1e3, y * 1e3, z * 1e3), self.set_point.quaternion)
        self._own += 1
        with suppress(TransportError):
            self._wire.send([encode_answer(SensorMessage(self._own, self._tm, reference))])

    def _over(self, cause: Exception) -> None:
        self._ended = cause
        for waiting in self._waiting:
            if not waiting.done():
                waiting.set_exception(cause)
                waiting.exception()

    # --- as a robot link

    def check(self) -> None:
        if self.mistake == "waits":
            return
        if self._ended is not None:
            raise self._ended
        if self.clock.now() - self.newest.received_at > SILENT_S:
            raise DeviceError(f"robot on {self.name} is silent")

    async def next_packet(self, patience: float = SILENT_S) -> None:
        if self._ended is not None:
            raise self._ended
        waiting: asyncio.Future[None] = self.clock.loop.create_future()
        self._waiting.add(waiting)
        try:
            async with asyncio.timeout(None if self.mistake == "waits" else patience):
                await waiting
        except TimeoutError:
            raise DeviceError(f"robot on {self.name} is silent") from None
        finally:
            self._waiting.discard(waiting)

    async def ready(self) -> RobotReport:
        ends = self.clock.now() + 10.0
        await self.next_packet(10.0)
        while self.newest.fault and self.clock.now() < ends:
            await self.next_packet()
        if self.newest.fault:
            raise DeviceError(self.newest.fault)
        return self.newest

    async def report(self, *, soon: bool = False) -> RobotReport:
        if self._handed_out or self.clock.now() - self.newest.received_at > 2.0 * CYCLE_S:
            await self.next_packet()
        self._handed_out = True
        return self.newest

    async def release(self, report: RobotReport) -> None:
        """Do nothing: no resource is open."""

    @asynccontextmanager
    async def motion(self, limits: MotionLimits) -> AsyncIterator[NaiveMotion]:
        await self.next_packet()
        if self.newest.fault:
            raise OrderRefused(self.newest.fault)
        motion = self.motion_now = NaiveMotion(self, limits)
        try:
            yield motion
            if motion.ordered and not (motion.halted or motion.abandoned):
                await motion.settled()
        finally:
            self.motion_now = None


def nearer(pose: Pose, target: Pose, step: float) -> Pose:
    """Return a pose on the path, `step` m farther."""
    distance = math.dist(pose.position, target.position)
    q = pose.quaternion
    flip = 1.0 if sum(a * b for a, b in zip(q, target.quaternion, strict=True)) >= 0.0 else -1.0
    angle = 2.0 * math.dist(q, [flip * one for one in target.quaternion])
    share = max(distance / step, angle / 0.002)
    if share <= 1.0:
        return target
    x, y, z = (a + (b - a) / share for a, b in zip(pose.position, target.position, strict=True))
    mixed = [a + (flip * b - a) / share for a, b in zip(q, target.quaternion, strict=True)]
    norm = math.hypot(*mixed)
    w, i, j, k = (one / norm for one in mixed)
    return Pose((x, y, z), (w, i, j, k))


async def connect(url: str, settings: KindSettings[NaiveSettings, EgmProfile], wiring: Any) -> NaiveLink:
    wire = await wiring.datagrams(url, speak_first=False)
    return NaiveLink(wire, wiring.clock, settings.client.mistake)


async def serve(url: str, robot: Any, settings: KindSettings[NaiveSettings, EgmProfile], serving: Any) -> str:
    address: str = await serving.serve_datagrams(url, robot.endpoint, speak_first=True)
    return address


EMULATION = RobotEmulation(
    EgmProfile,
    lambda settings: lambda start, now, seed: EgmController(settings.emulated, start, now, seed),
    serve,
    lambda settings, virtual: "udp+memory:naive",
    EGM_FAULTS,
)
ROBOT = RobotKind(
    "naive-robot", "EGM by another client", NaiveSettings, connect, lambda url, settings: FACTS, EMULATION
)


def settings(mistake: str = "") -> KindSettings[NaiveSettings, EgmProfile]:
    return KindSettings(NaiveSettings(mistake), EgmProfile())
