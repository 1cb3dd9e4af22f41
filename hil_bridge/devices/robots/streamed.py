"""Link of a robot that drives the cycle, for any `StreamClient` and wire."""

import asyncio
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from typing import Generic

import msgspec

from hil_bridge.clock import Clock
from hil_bridge.devices.device_log import DeviceLog
from hil_bridge.devices.facts import ANSWERS, MISSING, PACKETS, Hop, Owner, RobotHops, Traffic
from hil_bridge.devices.robots.gate import Bounds, Gate
from hil_bridge.devices.robots.motion_faults import describe_displacement
from hil_bridge.devices.robots.seam import MotionLimits, RobotFacts, RobotReport
from hil_bridge.devices.robots.setpoint_responder import SetpointResponder
from hil_bridge.devices.robots.streamed_motion import Stream, StreamedMotion
from hil_bridge.errors import BridgeError, Cause, DeviceError, OrderRefused, TransportClosed
from hil_bridge.errors.event_kinds import EventKind
from hil_bridge.errors.failures import blame, code_failed, link_cause
from hil_bridge.transports import Transport
from hil_bridge.transports.pump import Data, Pump
from protocol.endpoint import Trouble
from protocol.robot import ReportReceived, StreamClient, StreamEvent, StreamLost, StreamNotice

READY_S = 10.0
"""Longest wait for a robot's first packet, s. Chosen."""
SILENT_S = 0.5
"""Time without a packet after which a streaming robot counts as silent, s. Chosen: many cycles of the slowest robot."""
FRESH_CYCLES = 2.0
"""Largest age of a report that is still returned, in robot cycles. Chosen: one packet may be lost on the network."""
_START = "start its program, have it send to this computer's address and port, and check the firewall"
_CONTINUE = "check that its program still runs and its cable is plugged in, then start again"


HOPS = RobotHops(
    to_answer=(Hop("hand-over", "sent_at", "answered_at", Owner.SOFTWARE, "hand-over of the target"),),
    to_motion=(
        (
            Hop(
                "robot",
                "sent_at",
                "motion_at",
                Owner.ROBOT,
                "robot's packet, interpolator and path to the loops",
            ),
        ),
    ),
)
"""Hops into which the stamps of a stream divide a cycle. The robot receives the newest target in the answer to its
next packet.
"""


ROUTINE = PACKETS, ANSWERS
"""Counters of a stream that increase in normal operation."""
STALE = "stale packets"
TROUBLES = MISSING, STALE
"""Counters that indicate loss or delay on the wire. A late answer is not among them, because it is a delay of this
computer.
"""
TRAFFIC = (Traffic("packets", ANSWERS, PACKETS),)


class RobotSilent(DeviceError):
    """Error of a streaming robot that has stopped sending; it may resume."""


class StreamedLink(Generic[Data]):
    """Link of a streaming robot; see `hil_bridge.devices.robots.seam.RobotLink`."""

    def __init__(
        self,
        wire: Transport[Data],
        client: StreamClient[Data],
        facts: RobotFacts,
        clock: Clock,
        log: DeviceLog,
    ) -> None:
        """Create a link. `facts` must include the robot's cycle; otherwise raises ValueError."""
        if not facts.cycle_s:
            raise ValueError(f"{facts.model}: a streaming robot needs a cycle")
        self.name = wire.name.partition("?")[0]
        """Scheme and address of the wire for messages, without the options of the URL."""
        self.facts = msgspec.structs.replace(
            facts, hops=facts.hops or HOPS, routine=ROUTINE, errors=facts.errors or TROUBLES, traffic=TRAFFIC
        )
        self._fresh = FRESH_CYCLES * facts.cycle_s
        self._wire, self._clock, self._log = wire, clock, log
        self._client = client
        self._answering = SetpointResponder(client, facts.cycle_s)
        self._pump: Pump[Data, StreamEvent] = Pump(self._answering, wire, clock, self._take, self._ended)
        self._newest: RobotReport | None = None
        self._listened_from = clock.now()
        self._startup_error: DeviceError | None = None
        """Reason why nothing has been received since the start; None if unknown."""
        self._handed_out = False
        """Whether the newest report has been returned."""
        self._waiting: set[asyncio.Future[RobotReport]] = set()
        self._failure: BridgeError | None = None

    @property
    def counters(self) -> Mapping[str, int]:
        return self._answering.counters

    def start(self) -> None:
        self._listened_from = self._clock.now()
        self._pump.start()

    async def aclose(self) -> None:
        """End the movement, send queued data, and close the wire."""
        self._end()
        await self._wire.aclose()

    async def ready(self) -> RobotReport:
        report = await self._next(READY_S, _START)
        if report.fault:
            raise DeviceError(report.fault, remedy=report.remedy, cause=Cause.ROBOT_NOT_READY)
        return report

    async def report(self, *, soon: bool = False) -> RobotReport:
        newest = self._newest
        if newest is None or self._handed_out or self._clock.now() - newest.received_at > self._fresh:
            newest = await self._next_packet()
        self._handed_out = True
        if newest.fault:
            self._answering.faults.report()
        return newest

    async def release(self, report: RobotReport) -> None:
        """Do nothing. A movement ends with the stream, so no movement can have been left open."""

    @asynccontextmanager
    async def motion(self, limits: MotionLimits) -> AsyncIterator[StreamedMotion[Data]]:
        if self._answering.moving:
            raise OrderRefused(
                f"robot on {self.name}: a movement is in progress", remedy="end it before the next one"
            )
        report = await self._next_packet()
        if report.fault:
            raise OrderRefused(report.fault, remedy=report.remedy, cause=Cause.ROBOT_STATE)
        bounds = limits.bounds or Bounds(report.pose)
        if displacement := describe_displacement(bounds.start, report.pose):
            raise OrderRefused(f"robot on {self.name} {displacement}", cause=Cause.MOVED_BEFORE)
        now = self._clock.now()
        self._answering.begin(report.pose, limits, now)
        self._pump.kick()
        gate = Gate(bounds, now, report.pose)
        stream = Stream(self.name, self._check, self._next_packet)
        motion = StreamedMotion(stream, self._answering, self._clock, gate)
        try:
            yield motion
            if motion.ordered and not (motion.halted or motion.abandoned):
                await motion.settled()
        finally:
            self._end()

    def _end(self) -> None:
        self._answering.end()
        self._pump.kick()

    def _check(self) -> None:
        """Raise OrderRefused for a fault that persists or has not been reported yet, or another BridgeError if
        nothing can be ordered.
        """
        if self._failure is not None:
            raise self._failure
        answering = self._answering
        if fault := answering.faults.report():
            raise OrderRefused(
                f"the robot cannot move: {fault.fact}", remedy=fault.remedy, cause=Cause.ROBOT_STATE
            )
        if not answering.moving:
            why = answering.lost or Trouble("the movement has ended")
            remedy = "; ".join(filter(None, (why.remedy, "begin another movement")))
            raise DeviceError(f"robot on {self.name}: {why.fact}", remedy=remedy, cause=Cause.DEAD_LINK)
        assert self._newest is not None, "a movement begins with a report"
        if self._clock.now() - self._newest.received_at > SILENT_S:
            raise self._silent(SILENT_S, _CONTINUE)

    async def _next_packet(self) -> RobotReport:
        return await self._next(SILENT_S, _CONTINUE)

    async def _next(self, patience: float, remedy: str) -> RobotReport:
        """Return the next report. `remedy` is the advice for a robot that has sent packets before. Raises
        BridgeError if no report arrives.
        """
        if self._failure is not None:
            raise self._failure
        loop = self._clock.loop
        waiting: asyncio.Future[RobotReport] = loop.create_future()
        self._waiting.add(waiting)
        expiry = loop.call_later(patience, self._expire, waiting, patience, remedy)
        try:
            return await waiting
        finally:
            expiry.cancel()
            self._waiting.discard(waiting)

    def _expire(self, waiting: "asyncio.Future[RobotReport]", patience: float, remedy: str) -> None:
        """Fail a wait for a report that has taken too long."""
        if not waiting.done():
            waiting.set_exception(self._startup_error or self._silent(patience, remedy))

    def _take(self, event: StreamEvent) -> None:
        match event:
            case ReportReceived(report=report):
                if report.fault:
                    report = report._replace(fault=f"the robot cannot move: {report.fault}")
                self._newest, self._handed_out = report, bool(self._waiting)
                self._startup_error = None
                for waiting in self._waiting:
                    if not waiting.done():
                        waiting.set_result(report)
            case StreamLost(text=text, remedy=remedy):
                lost = DeviceError(f"robot on {self.name}: {text}", remedy=remedy, cause=Cause.DEAD_LINK)
                self._startup_error = lost if self._newest is None else None
                self._log.notice(EventKind.LINK, str(lost))
                self._fail(lost)
            case StreamNotice(kind=kind, text=text):
                self._log.notice(kind, text)

    def _silent(self, seconds: float, remedy: str) -> RobotSilent:
        newest = self._newest
        if newest is None:
            seconds, remedy = max(seconds, round(self._clock.now() - self._listened_from, 1)), _START
        before = ""
        if newest is not None and newest.fault:
            before, remedy = f"before that, {newest.fault}", newest.remedy or remedy
        text = f"robot on {self.name} sent nothing for {seconds:g} s"
        return RobotSilent(text, remedy=remedy, facts=before, cause=Cause.DEAD_LINK)

    def _ended(self, cause: BaseException) -> None:
        blame(cause, self._client, "receive")
        self._failure = code_failed(f"robot link {self.name}", cause, link_cause(cause))
        if not isinstance(cause, TransportClosed):
            self._log.notice(EventKind.LINK, str(self._failure))
        self._fail(self._failure)

    def _fail(self, error: BridgeError) -> None:
        """Fail all pending waits for a report."""
        for waiting in self._waiting:
            if not waiting.done():
                waiting.set_exception(error)
                waiting.exception()  # mark the exception as retrieved, even if the caller is cancelled before it awaits
