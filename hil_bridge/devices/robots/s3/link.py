"""Link to the S3 controller for a run: orders over the computer link, and movements as context managers."""

import asyncio
import math
from collections import Counter, deque
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager, suppress
from typing import TypeVar, overload

from hil_bridge.clock import Clock
from hil_bridge.devices.device_log import DeviceLog
from hil_bridge.devices.robots.gate import Bounds, Gate
from hil_bridge.devices.robots.motion_faults import describe_displacement
from hil_bridge.devices.robots.request_channel import RequestChannel
from hil_bridge.devices.robots.s3.facts import robot_facts
from hil_bridge.devices.robots.s3.motion import S3Motion
from hil_bridge.devices.robots.s3.status_faults import describe_new_stop, describe_stop
from hil_bridge.devices.robots.seam import (
    QUESTION_LEFT,
    MotionLimits,
    RobotReport,
    Sent,
    orientation_fault,
)
from hil_bridge.errors import BridgeError, Cause, DeviceError, OrderRefused
from hil_bridge.errors.event_kinds import EventKind
from hil_bridge.transports import Direction, Tap, Transport
from protocol.devices.s3.adlp import (
    ROUTINE,
    TRAILER,
    Control,
    Count,
    LinkFailed,
    LinkFailure,
    LinkNotice,
    LinkProfile,
    NoticeKind,
)
from protocol.devices.s3.arap import (
    KNOWN,
    Answered,
    ArapEvent,
    ArapHost,
    FunctionCode,
    Mode,
    Move,
    MoveKind,
    OrderBook,
    OrderFailed,
    ProgramAnswer,
    Refusal,
    RefusalCode,
    Refused,
    SpontaneousReceived,
    Status,
    Telegram,
    UnexpectedReceived,
    Value,
    read_status,
    receive_program,
    refusal_remedy,
    write_mode,
)
from protocol.devices.s3.timing import answer_time
from protocol.endpoint import RemoteProtocolError, Trouble
from protocol.geometry import Pose

_Raw = TypeVar("_Raw")
_Meaning = TypeVar("_Meaning")

_SENT = Direction.SENT
_ENQ, _EOT = int(Control.ENQ), int(Control.EOT)
_NO_START_POINT = RefusalCode.OUTSIDE_WORK_AREA
"""Refusal code of a move without a sequence or without a start point. Source: project specification, section 3."""
_SLOWEST_M_S = 1e-3
"""Velocity of an order that must not cause motion, m/s. Chosen."""
_READ_STATUS = FunctionCode.READ_STATUS
STATUS_S = 1.0
"""Longest wait for a status that may explain the failure of an order, s. Chosen: a robot that answers at all does
so in a tenth of this time.
"""
MESSAGE_AGE_S = 15.0
"""Largest age of an unsolicited message that is reported with a failure, s. Chosen: the longest wait for an answer,
plus the start-up time of the robot.
"""
TRAILER_NOTICE_S = 60.0
"""Shortest time between two notices that an order contains 10 03, s. Every occurrence is counted. Chosen."""
_QUANTITIES = (Count.BLOCKS_SENT, Count.BLOCKS_RECEIVED, Count.MESSAGES_SENT, Count.MESSAGES_RECEIVED)


def _format_age(seconds: float) -> str:
    return f"{seconds:.1f} s before" if seconds >= 0.05 else "at that moment"


class S3Link:
    """Client of the S3 controller's computer link; see `hil_bridge.devices.robots.seam.RobotLink`.

    The client sends one order at a time, and each order has exactly one answer, as the link requires. The log
    receives the events that are relevant for the recording: repeats, time-outs, noise, unsolicited messages.
    """

    def __init__(
        self,
        transport: Transport[bytes],
        profile: LinkProfile,
        clock: Clock,
        log: DeviceLog,
        orders: OrderBook = KNOWN,
    ) -> None:
        """Connect the link. A `verbose` log also receives each bid and ACK, which takes time in every cycle."""
        self.name = transport.name
        self.profile = profile
        self.facts = robot_facts(profile)
        self._transport = Tap(transport, self._passed)
        self._clock = clock
        self._log = log
        self._orders = orders
        self._host = ArapHost(profile)
        self._host.link.verbose = log.verbose
        self._requests: RequestChannel[bytes, ArapEvent, Telegram] = RequestChannel(
            self._host,
            self._transport,
            clock,
            self._take,
            lambda failure: log.notice(EventKind.LINK, str(failure)),
        )
        self.begun_at = math.nan
        """Time at which the first byte of the newest order's bid was passed to the port, s on the run's clock. If
        the bid was sent ahead of the order, the time at which the order was passed to the link. NaN if neither has
        happened.
        """
        self.transmitted_at = math.nan
        """Time at which the last character of the newest order left the line, s on the run's clock; this character
        ends the message. Ports do not report this time, so it is calculated from the time at which the character
        was passed to the port, and from the line's rate.
        """
        self._answered_at = math.nan
        self._answer_time = answer_time(profile)
        """Duration of a status answer on the line, s. This is the age of the reported pose when the answer is
        complete.
        """
        self._reports = 0
        self._soon = False
        """Whether another order follows the present one at once."""
        self._status: Status | None = None
        """Newest status of the robot."""
        self._fit: Status | None = None
        """Status of the robot at the start of the movement."""
        self._messages: deque[tuple[float, str]] = deque(maxlen=3)
        """Unsolicited messages of the robot with their times, s on the run's clock."""
        self._troubles: Counter[str] = Counter()
        """Problems on the link since the newest order began."""
        self._trailer_noticed_at = -math.inf
        """Time of the last notice that an order contains 10 03, s on the run's clock."""
        self._explaining = False
        """Whether the purpose of the present order is to explain the failure of another order."""

    @property
    def counters(self) -> Mapping[str, int]:
        """Link-level counts since the link was opened, by name: bids, repeats, time-outs, noise bytes and others."""
        return self._host.link.counters

    def start(self) -> None:
        """Start receiving."""
        self._requests.start()

    async def aclose(self) -> None:
        """Send queued data and close the port."""
        await self._transport.aclose()

    @property
    def sent(self) -> Sent:
        """Times at which the newest order was sent and at which its answer was complete."""
        return Sent(self.begun_at, self.transmitted_at, self._answered_at)

    async def ready(self) -> RobotReport:
        """Switch the controller to operation, in which it can move."""
        status = await self.read_status()
        if not status.operation and not status.emergency_stop:
            await self.exchange(write_mode(Mode.OPERATION))
            status = await self.read_status()
        report = self._reported(status)
        if report.fault:
            raise DeviceError(
                report.fault, remedy=report.remedy, facts=report.facts, cause=Cause.ROBOT_NOT_READY
            )
        return report

    async def report(self, *, soon: bool = False) -> RobotReport:
        return self._reported(await self.read_status(soon=soon))

    def _reported(self, status: Status) -> RobotReport:
        self._reports += 1
        now = self._answered_at
        fault, remedy, facts = self._fault(status)
        return RobotReport(
            self._reports,
            Pose(status.position, status.quaternion),
            now - self._answer_time,
            now,
            fault,
            ((QUESTION_LEFT, self.transmitted_at),),
            remedy=remedy,
            facts=facts,
        )

    @overload
    async def order(self, order: Telegram, /) -> Telegram: ...

    @overload
    async def order(
        self, order: str, /, *, suffix: int | None = None, **values: Value
    ) -> Mapping[str, Value]: ...

    async def order(
        self, order: Telegram | str, /, *, suffix: int | None = None, **values: Value
    ) -> Telegram | Mapping[str, Value]:
        """Send one order and wait for its answer. An order is either a telegram, or a name with values in their
        units.

        The names are the names of the known orders and of the site's orders file. Values that are not given are 0.
        `suffix` selects a function suffix other than the default.

        Raises LocalProtocolError for an invalid name, value or length, before anything is sent; OrderRefused if the
        controller refuses, DeviceError if the link fails or the answer is too short, TransportError if the wire
        fails.
        """
        if isinstance(order, Telegram):
            return await self.exchange(order)
        definition = self._orders.named(order)
        answer = await self.exchange(*definition.telegrams(values, suffix, self.profile))
        return self._decode(definition.answer.decode, answer.data)

    async def read_status(self, *, soon: bool = False) -> Status:
        """Read mode, flags, position and orientation from the controller. For `soon`, see `exchange`."""
        answer = await self.exchange(read_status(), soon=soon)
        self._status = self._decode(Status.from_telegram, answer)
        return self._status

    async def receive_program(self, number: int) -> bytes:
        """Read the contents of a program from the controller. Errors as for `order`, and DeviceError if the
        controller does not send the program.
        """
        answer = self._decode(ProgramAnswer.from_telegram, await self.exchange(receive_program(number)))
        if answer.error:
            raise DeviceError(f"robot on {self.name} did not send program {number}: error {answer.error}")
        if answer.program != number:
            raise DeviceError(f"robot on {self.name} sent program {answer.program}, not {number}")
        return answer.content

    async def exchange(self, *telegrams: Telegram, soon: bool = False) -> Telegram:
        """Send an order of one or more blocks and wait for its answer. Errors as for `order`.

        With `soon`, the bid for the next order is sent together with the end of the answer. The controller then
        acknowledges it while the caller is still deciding, unless the profile's `bid_ahead` is off. The caller must
        therefore give the next order soon.

        The error of an order that was refused or not answered also contains recent unsolicited messages of the
        robot, and the robot's status if it still answers.
        """

        def order() -> None:
            self._host.order(*telegrams)
            if self._troubles:
                self._troubles.clear()
            self._soon = soon and self.profile.bid_ahead
            self.begun_at = self._clock.now() if self._host.link.ahead else math.nan
            self.transmitted_at = self._answered_at = math.nan

        try:
            answer = await self._requests.exchange(order)
        except DeviceError as error:
            if not self._explaining:
                await self._explain(error, telegrams[0])
            raise
        return answer

    async def _explain(self, error: DeviceError, order: Telegram) -> None:
        """Add all further information about the cause to an error."""
        failed_at, refused, facts = self._clock.now(), isinstance(error, OrderRefused), []
        if self._status is not None and not (refused and order.function == _READ_STATUS):
            self._explaining = True
            try:
                async with asyncio.timeout(STATUS_S):
                    stop = describe_new_stop(await self.read_status(), self._fit)
                if stop:
                    facts.append(f"its status is now: {stop}")
                elif not refused:
                    facts.append("it answers again, and its status shows no stop")
            except (BridgeError, TimeoutError):
                pass  # the link no longer answers
            finally:
                self._explaining = False
        facts += self._recent_messages(failed_at)
        error.facts = "; ".join(filter(None, (error.facts, *facts)))

    def _decode(self, read: Callable[[_Raw], _Meaning], raw: _Raw) -> _Meaning:
        """Decode an answer. Raises DeviceError if the answer is invalid."""
        try:
            return read(raw)
        except RemoteProtocolError as error:
            text = f"robot on {self.name} sent an invalid answer: {error}"
            raise DeviceError(text, cause=Cause.ROBOT_FAILED) from error

    def _fault(self, status: Status) -> tuple[str, str, str]:
        """Describe the flags of a status that prevent motion, what helps, and the robot's recent messages. Return
        empty texts if there are none.
        """
        if stop := describe_stop(status, self.profile.check_flags):
            states, remedy = stop
            messages = self._recent_messages(self._clock.now())
            return f"the robot cannot move: {states}", remedy, "; ".join(messages)
        fault = orientation_fault(status.quaternion)
        return fault and f"robot on {self.name} reports {fault}", "", ""

    def _recent_messages(self, now: float) -> list[str]:
        """Return descriptions of recent unsolicited messages of the robot."""
        return [
            f"it reported {text}, {_format_age(now - at)}"
            for at, text in self._messages
            if 0.0 <= now - at <= MESSAGE_AGE_S
        ]

    async def release(self, report: RobotReport) -> None:
        """End a movement sequence that an earlier run left open. If no sequence is open, the controller refuses the
        order, and the refusal is ignored.
        """
        end = S3Motion(self, _SLOWEST_M_S).telegram(MoveKind.END, *report.pose)
        with suppress(OrderRefused):
            await self.exchange(end)
            self._log.notice(EventKind.MOTION, "an open movement sequence of an earlier run was closed")

    @asynccontextmanager
    async def motion(self, limits: MotionLimits) -> AsyncIterator[S3Motion]:
        """Run a movement sequence with the speed and the bounds of the limits. The other limits apply to streams
        only.
        """
        self._fit = status = self._status
        present = None if status is None else Pose(status.position, status.quaternion)
        bounds = limits.bounds or Bounds()
        if (
            limits.bounds
            and present
            and (displacement := describe_displacement(limits.bounds.start, present))
        ):
            raise OrderRefused(f"robot on {self.name} {displacement}", cause=Cause.MOVED_BEFORE)
        gate = Gate(bounds, self._clock.now(), present)
        motion = S3Motion(
            self, limits.speed, present, lambda pose: gate.judge(pose, self._clock.now()), gate.take_back
        )
        try:
            await self.exchange(motion.telegram(MoveKind.START))
        except OrderRefused as refused:
            if refused.code != _NO_START_POINT:
                raise
            # Assumed: a controller whose sequence is still open refuses to begin another.
            await self.release(await self.report())
            await self.exchange(motion.telegram(MoveKind.START))
        try:
            yield motion
        except BaseException:
            try:
                await asyncio.shield(motion.end())
            except BridgeError as error:
                self._log.notice(EventKind.MOTION, f"the movement could not be ended: {error}")
            raise
        else:
            await motion.end()

    def encoded(self, move: Move) -> Telegram:
        """Encode a move for this link, with the length style of the profile. If its position or orientation would
        contain 10 03, which a controller may interpret as the end of the block, a neighbouring step is used.

        No coordinate is then farther than one step of 0.125 mm from the ordered coordinate, into the surface no
        more than out of it. This event is counted.
        """
        length = self.profile.move_length
        telegram = move.to_telegram(length)
        if TRAILER not in telegram.data or not self.profile.avoids_trailer:
            return telegram
        avoiding = move.to_telegram(length, avoid_trailer=True)
        if avoiding != telegram:
            self._host.link.note(NoticeKind.TRAILER_AVOIDED, "a move was shifted by one step")
        return avoiding

    def _passed(self, direction: Direction, data: bytes) -> None:
        """Record the transmission times of an order: the time of its first bid, and the time of its last character."""
        if direction is not _SENT or not self._requests.under_way:
            return
        if data[-1] == _ENQ and math.isnan(self.begun_at):
            self.begun_at = self._clock.now()
        elif data[-1] == _EOT:
            self.transmitted_at = self._clock.now() + len(data) * self.profile.character_time

    def _take(self, event: ArapEvent) -> None:
        match event:
            case Answered(answer=answer):
                soon = self._soon and self._requests.awaited
                self._answered_at = self._clock.now()
                self._requests.resolve(answer)
                if soon:
                    self._host.announce()
            case Refused(order=order, refusal=refusal):
                self._requests.resolve(self._refused(order, refusal))
            case OrderFailed():
                self._requests.resolve(self._explain_silence(event))
            case SpontaneousReceived(spontaneous=spontaneous):
                self._messages.append((self._clock.now(), spontaneous.text))
                self._log.notice(EventKind.ROBOT, spontaneous.text)
            case LinkNotice(kind=kind, text=text):
                if kind not in ROUTINE:
                    self._troubles[kind] += 1
                if kind is NoticeKind.TRAILER_SENT:
                    if self._clock.now() < self._trailer_noticed_at + TRAILER_NOTICE_S:
                        return
                    self._trailer_noticed_at = self._clock.now()
                self._log_link_event(kind + ": " + text, routine=kind in ROUTINE)
            case LinkFailed(reason=reason, text=text, remedy=remedy):
                self._log_link_event(f"{reason}: {Trouble(text, remedy)}")
            case UnexpectedReceived():
                self._log_link_event(event.text)

    def _log_link_event(self, text: str, *, routine: bool = False) -> None:
        self._log.link_event("robot", text)
        if not routine:
            self._log.notice(EventKind.LINK, text)

    def _refused(self, order: Telegram, refusal: Refusal) -> OrderRefused:
        text = f"the robot refused order {order.function}: {refusal.code} {refusal.text}"
        remedy = refusal_remedy(refusal.code)
        return OrderRefused(text, refusal.code, remedy=remedy)

    def _explain_silence(self, failed: OrderFailed) -> DeviceError:
        line = f"{self.profile.baudrate} 8{self.profile.parity}{self.profile.stop_bits}"
        facts = ""
        match failed.reason:
            case LinkFailure.NO_ANSWER | LinkFailure.ONLY_NOISE if self._status is not None:
                facts = "it answered before, so the line settings are correct"
                advice = "check its power and the cable"
            case LinkFailure.NO_ANSWER | LinkFailure.ONLY_NOISE:
                facts, advice = f"this end is set to {line}", failed.remedy
            case _ if self._troubles:
                counts = ", ".join(f"{kind} {count}" for kind, count in self._troubles.items())
                facts, advice = f"on the link meanwhile: {counts}", ""
            case _:
                advice = "see the recording for the traffic on the link"
        text = f"robot on {self.name}: {failed.text}"
        return DeviceError(text, remedy=advice, facts=facts, cause=Cause.DEAD_LINK)
