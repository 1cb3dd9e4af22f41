"""The robot controller as the cycle sees it: orders over the computer link, a movement as a context."""

import asyncio
import math
from collections import Counter, deque
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import asynccontextmanager, suppress
from typing import TypeVar, overload

from hil_bridge.clock import Clock
from hil_bridge.errors import BridgeError, DeviceError, OrderRefused, TransportClosed
from hil_bridge.transports import Transport
from hil_bridge.transports.pump import Pump
from protocol.endpoint import RemoteProtocolError
from protocol.geometry import Pose, Quaternion, Vector
from protocol.s3.adlp import ROUTINE, Control, LinkFailed, LinkFailure, LinkNotice, LinkProfile
from protocol.s3.arap import (
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
    OrderFailure,
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
    stop_program,
    write_mode,
)

_Raw = TypeVar("_Raw")
_Meaning = TypeVar("_Meaning")

_ENQ, _EOT = int(Control.ENQ), int(Control.EOT)
_POINT = MoveKind.POINT
_NO_START_POINT = RefusalCode.OUTSIDE_WORK_AREA
"""What refuses a move for want of a sequence, or of a start point. Source: project specification, section 3."""
UNIT_TOLERANCE = 0.01
"""Chosen: how far a quaternion's norm may be from 1; words of 1/16384 alone make up 0.0001."""
_SLOWEST_M_S = 1e-3
"""Chosen: velocity of an order that is not to move anything, m/s."""
_READ_STATUS = FunctionCode.READ_STATUS
_ZEROS: Vector = (0.0, 0.0, 0.0)
"""What a start, and an end without any point before it, carry as coordinates."""
STATUS_S = 1.0
"""For how long a status is waited for that may tell why an order failed. Chosen: a robot that answers does so in a
tenth of it.
"""
SAID_S = 15.0
"""How long ago the robot may have said something that is told with a failure. Chosen: the longest wait for an answer,
and its start-up.
"""
_STATES = (
    ("emergency_stop", True, "emergency stop", "release it at the controller's panel"),
    ("key_auto", False, "key not in AUTO", "turn it (or see robot.link.check_flags)"),
    (
        "local",
        True,
        "link control taken back",
        "give it at the teach pendant (or see robot.link.check_flags)",
    ),
    ("operation", False, "in standby", "start again"),
)
"""What of a status keeps the robot from moving: flag, value, words, remedy."""
_SURE = ("emergency_stop", "operation")
"""Flags of it that were observed; where the others are is assumed."""


class _SentWatch:
    """The wire as it is, but that `on_sent` is shown what it has taken."""

    __slots__ = ("_on_sent", "_send", "aclose", "name", "start")

    def __init__(self, wire: Transport[bytes], on_sent: Callable[[bytes], None]) -> None:
        self.name = wire.name
        self.start, self.aclose, self._send = wire.start, wire.aclose, wire.send
        self._on_sent = on_sent

    def send(self, data: bytes) -> None:
        """As the wire does."""
        self._send(data)
        self._on_sent(data)


class RobotLink:
    """Client of the S3 controller's computer link.

    One order at a time, each with exactly one answer, as the link demands. `on_notice(kind, text)` is told what
    is worth a line in the record: repeats, time-outs, noise, spontaneous messages. `on_link_event(text)` is told all
    that happens on the link, each bid and ACK too.
    """

    def __init__(
        self,
        transport: Transport[bytes],
        profile: LinkProfile,
        clock: Clock,
        on_notice: Callable[[str, str], None],
        orders: OrderBook = KNOWN,
        on_link_event: Callable[[str], object] | None = None,
    ) -> None:
        self.name = transport.name
        self.profile = profile
        self._transport = _SentWatch(transport, self._sent)
        self._clock = clock
        self.begun_at = math.nan
        """When the newest order's first byte, that of the bid, was handed to the port, s on the run's clock, or the
        order itself to the link, if the bid had gone out ahead of it; NaN where neither happened.
        """
        self.transmitted_at = math.nan
        """When its last character, that ends the message, has left the line: reckoned from when it was handed to the
        port, at the line's rate, for ports do not tell.
        """
        self._on_notice = on_notice
        self._orders = orders
        self._on_link_event = on_link_event
        self._host = ArapHost(profile)
        self._host.link.verbose = on_link_event is not None
        self._pump: Pump[bytes, ArapEvent] = Pump(self._host, self._transport, clock, self._take, self._ended)
        self._announce = False
        """The order under way is followed by another at once."""
        self._answer: asyncio.Future[Telegram] | None = None
        """Of the order under way; cancelled when nobody waits for it any more."""
        self._waiting: deque[asyncio.Future[None]] = deque()
        """Those who wait for the order under way to end."""
        self._failure: BridgeError | None = None
        self._status: Status | None = None
        """The newest."""
        self._fit: Status | None = None
        """As the robot was when the movement began."""
        self._said: deque[tuple[float, str]] = deque(maxlen=3)
        """What the robot said unasked, and when, s on the run's clock."""
        self._troubles: Counter[str] = Counter()
        """What went wrong on the link since the newest order began."""
        self._explaining = False
        """The order under way is to tell why another one failed."""

    @property
    def counters(self) -> Mapping[str, int]:
        """Link-level counts since opening: bids, repeats, time-outs, noise bytes and so on, by name."""
        return self._host.link.counters

    def start(self) -> None:
        """Begin to listen."""
        self._pump.start()

    async def aclose(self) -> None:
        """Hand over what is queued and close the port."""
        await self._transport.aclose()

    @overload
    async def order(self, order: Telegram, /) -> Telegram: ...

    @overload
    async def order(
        self, order: str, /, *, suffix: int | None = None, **values: Value
    ) -> Mapping[str, Value]: ...

    async def order(
        self, order: Telegram | str, /, *, suffix: int | None = None, **values: Value
    ) -> Telegram | Mapping[str, Value]:
        """Send one order and wait for its answer: a telegram for a telegram, or by name and values in their units.

        The names are those of the known orders and of the site's orders file; what is not given is 0. `suffix`
        chooses another function suffix than the usual one.

        Raises LocalProtocolError for a name, a value or a length that cannot be, before anything is sent;
        OrderRefused when the controller refuses, DeviceError when the link fails or the answer is too short,
        TransportError when the wire does.
        """
        if isinstance(order, Telegram):
            return await self.exchange(order)
        definition = self._orders.named(order)
        answer = await self.exchange(*definition.telegrams(values, suffix, self.profile))
        return self._understood(definition.answer.decode, answer.data)

    async def read_status(self, *, announce: bool = False) -> Status:
        """Mode, flags, reported position and orientation, from the controller; `announce` as in `exchange`."""
        answer = await self.exchange(read_status(), announce=announce)
        self._status = self._understood(Status.from_telegram, answer)
        return self._status

    async def receive_program(self, number: int) -> bytes:
        """The contents of a program, from the controller; errors as `order`, DeviceError also for one that it has
        not sent.
        """
        answer = self._understood(ProgramAnswer.from_telegram, await self.exchange(receive_program(number)))
        if answer.error:
            raise DeviceError(f"robot on {self.name} did not send program {number}: error {answer.error}")
        if answer.program != number:
            raise DeviceError(f"robot on {self.name} sent program {answer.program}, not {number}")
        return answer.content

    async def exchange(self, *telegrams: Telegram, announce: bool = False) -> Telegram:
        """Send one order, of one block or several, and wait for its answer; errors as `order`.

        With `announce` the bid for the next order goes out with the end of the answer, so that the controller
        acknowledges it while the caller still makes up its mind, unless the profile's `bid_ahead` is off. The caller
        must give an order then, and soon.

        The error of an order that was refused, or not answered, also tells what the robot said shortly before and what
        its status shows, if it still answers.
        """
        loop = self._clock.loop
        while self._answer is not None:  # a cancelled caller may have left its order under way
            ended = loop.create_future()
            self._waiting.append(ended)
            await ended
        if self._failure is not None:
            raise self._failure
        self._host.order(*telegrams)
        if self._troubles:
            self._troubles.clear()
        self._announce = announce and self.profile.bid_ahead
        self.begun_at = self._clock.now() if self._host.link.ahead else math.nan
        self.transmitted_at = math.nan
        answer: asyncio.Future[Telegram] = loop.create_future()
        self._answer = answer
        self._pump.kick()
        try:
            return await answer
        except DeviceError as error:
            if not self._explaining:
                await self._tell_more(error, telegrams[0])
            raise

    async def _tell_more(self, error: DeviceError, order: Telegram) -> None:
        """Add to an error what else is known of its cause."""
        failed_at, refused, facts = self._clock.now(), isinstance(error, OrderRefused), []
        if self._status is not None and not (refused and order.function == _READ_STATUS):
            self._explaining = True
            try:
                async with asyncio.timeout(STATUS_S):
                    hindrance = _hindrance(await self.read_status(), self._fit)
                if hindrance:
                    facts.append(f"its status now shows: {hindrance}")
                elif not refused:
                    facts.append("now it answers again, and its status shows no stop")
            except (BridgeError, TimeoutError):
                pass  # the link does not answer any more
            finally:
                self._explaining = False
        facts += self._said_before(failed_at)
        error.args = ("; ".join((str(error), *facts)),)

    def _understood(self, read: Callable[[_Raw], _Meaning], raw: _Raw) -> _Meaning:
        """What an answer means. Raises DeviceError when it cannot be read."""
        try:
            return read(raw)
        except RemoteProtocolError as error:
            raise DeviceError(f"robot on {self.name} gave an answer that cannot be read: {error}") from error

    def fault(self, status: Status) -> str:
        """What in a status forbids to move, in words with what is known of its cause; empty while nothing does."""
        shown = [
            (words, remedy)
            for name, value, words, remedy in _STATES
            if getattr(status, name) is value and (self.profile.check_flags or name in _SURE)
        ]
        if shown:
            facts = (
                _together([words for words, _ in shown]),
                shown[0][1],
                *self._said_before(self._clock.now()),
            )
            return f"robot on {self.name} cannot move; its status now shows: {'; '.join(facts)}"
        length = math.hypot(*status.quaternion)
        if abs(length - 1.0) > UNIT_TOLERANCE:
            return f"robot on {self.name} reports the orientation {status.quaternion}, which is none"
        return ""

    def _said_before(self, now: float) -> list[str]:
        """What the robot said unasked shortly before, in words."""
        return [
            f"it had said {now - at:.1f} s before: {text}"
            for at, text in self._said
            if 0.0 <= now - at <= SAID_S
        ]

    async def close_sequence(self, status: Status) -> None:
        """End a movement sequence that an earlier run left open, where the robot reports to be; a controller that has
        none open refuses, which is well.
        """
        end = Motion(self, _SLOWEST_M_S).telegram(MoveKind.END, status.position, status.quaternion)
        with suppress(OrderRefused):
            await self.exchange(end)
            self._on_notice("motion", "a movement sequence that was left open has been closed")

    async def to_operation(self) -> None:
        """Ask for the operation mode, in which the controller moves."""
        await self.exchange(write_mode(Mode.OPERATION))

    @asynccontextmanager
    async def motion(self, velocity: float) -> AsyncIterator["Motion"]:
        """A movement sequence: entering starts it, leaving ends it at the last point, whatever happened inside.

        `velocity` is the speed along the path, m/s.
        """
        motion = Motion(self, velocity)
        self._fit = self._status
        try:
            await self.order(motion.telegram(MoveKind.START))
        except OrderRefused as refused:
            if refused.code != _NO_START_POINT:
                raise
            # Assumed: a controller whose sequence is still open refuses to begin another.
            await self.close_sequence(await self.read_status())
            await self.order(motion.telegram(MoveKind.START))
        try:
            yield motion
        except BaseException:
            try:
                await asyncio.shield(motion.end())
            except BridgeError as error:
                self._on_notice("motion", f"the movement could not be ended: {error}")
            raise
        else:
            await motion.end()

    def _sent(self, data: bytes) -> None:
        """Stamp an order's way out: the first bid, and what ended it last."""
        if self._answer is None:
            return
        if data[-1] == _ENQ and math.isnan(self.begun_at):
            self.begun_at = self._clock.now()
        elif data[-1] == _EOT:
            self.transmitted_at = self._clock.now() + len(data) * self.profile.character_time

    def _take(self, event: ArapEvent) -> None:
        match event:
            case Answered(answer=answer):
                announce = self._announce and self._answer is not None and not self._answer.cancelled()
                self._resolve(answer)
                if announce:
                    self._host.announce()
            case Refused(order=order, refusal=refusal):
                self._resolve(self._refused(order, refusal))
            case OrderFailed(reason=reason, text=text):
                self._resolve(DeviceError(self._explain(reason, text)))
            case SpontaneousReceived(spontaneous=spontaneous):
                self._said.append((self._clock.now(), spontaneous.text))
                self._on_notice("robot", spontaneous.text)
            case LinkNotice(kind=kind, text=text):
                if kind not in ROUTINE:
                    self._troubles[kind] += 1
                self._tell_link_event(kind + ": " + text, routine=kind in ROUTINE)
            case LinkFailed(reason=reason, text=text):
                self._tell_link_event(f"{reason}: {text}")
            case UnexpectedReceived():
                self._tell_link_event(event.text)

    def _tell_link_event(self, text: str, *, routine: bool = False) -> None:
        if self._on_link_event is not None:
            self._on_link_event(text)
        if not routine:
            self._on_notice("link", text)

    def _resolve(self, outcome: Telegram | BridgeError) -> None:
        answer, self._answer = self._answer, None
        if answer is None:
            return
        if answer.cancelled():
            pass  # nobody waits any more
        elif isinstance(outcome, BridgeError):
            answer.set_exception(outcome)
            answer.exception()  # seen, also when its caller is cancelled before it looks
        else:
            answer.set_result(outcome)
        while self._waiting:
            ended = self._waiting.popleft()
            if not ended.done():
                ended.set_result(None)

    def _ended(self, cause: BaseException) -> None:
        if isinstance(cause, BridgeError):
            self._failure = cause
        else:
            self._failure = DeviceError(f"robot link {self.name} stopped: {cause!r}")
            self._failure.__cause__ = cause
        if not isinstance(cause, TransportClosed):
            self._on_notice("link", str(self._failure))
        self._resolve(self._failure)

    def _refused(self, order: Telegram, refusal: Refusal) -> OrderRefused:
        text = f"robot on {self.name} refused order {order.function}: {refusal.code} {refusal.text}"
        remedy = refusal_remedy(refusal.code)
        return OrderRefused(f"{text}; {remedy}" if remedy else text, refusal.code)

    def _explain(self, reason: LinkFailure | OrderFailure, text: str) -> str:
        line = f"{self.profile.baudrate} 8{self.profile.parity}{self.profile.stop_bits}"
        match reason:
            case LinkFailure.NO_ANSWER | LinkFailure.ONLY_NOISE if self._status is not None:
                text = text.partition(":")[0]
                advice = "it has answered before, so the line is set right: is it off, or a cable out?"
            case LinkFailure.NO_ANSWER | LinkFailure.ONLY_NOISE:
                advice = f"this end is set to {line}"
            case _ if self._troubles:
                counts = ", ".join(f"{kind} {count}" for kind, count in self._troubles.items())
                advice = f"on the link meanwhile: {counts}"
            case _:
                advice = "see the record for what went over the link"
        return f"robot on {self.name}: {text}; {advice}"


def _hindrance(status: Status, fit: Status | None) -> str:
    """What in a status keeps the robot from moving, in words, but for what held already when it was `fit` to move."""
    new = [
        words
        for name, value, words, _ in _STATES
        if getattr(status, name) is value and (fit is None or getattr(fit, name) is not value)
    ]
    return _together(new)


def _together(states: Sequence[str]) -> str:
    return (
        "in standby, as after a restart or by hand" if list(states) == ["in standby"] else ", ".join(states)
    )


class Motion:
    """A movement sequence under way. Points are absolute tool positions in the robot's base frame."""

    def __init__(self, link: RobotLink, velocity: float) -> None:
        self._link = link
        self.velocity = velocity
        """Speed along the path for the orders to come, m/s."""
        self._last: Pose | None = None
        self.halted = False
        """It was ordered to stand still: nothing more can be ordered."""
        self.abandoned = False
        """The robot does not answer: nothing more is ordered."""

    @property
    def ordered(self) -> bool:
        """Whether a point has been taken in this sequence, as far as is known."""
        return self._last is not None

    @property
    def commanded(self) -> Vector | None:
        """The last point ordered, base frame, m; None before the first."""
        return None if self._last is None else self._last.position

    def telegram(
        self, kind: MoveKind, position: Vector = _ZEROS, quaternion: Quaternion = (*_ZEROS, 0.0)
    ) -> Telegram:
        """The order for one step of the sequence; position in m, quaternion w x y z, tool in base."""
        return Move(kind, position, quaternion, self.velocity).to_telegram(self._link.profile.move_length)

    async def to(self, position: Vector, quaternion: Quaternion, *, announce: bool = False) -> None:
        """Order the next point; returns when the controller has taken it, not when it is reached. `announce` as in
        `RobotLink.exchange`.
        """
        before, self._last = self._last, Pose(position, quaternion)
        try:
            await self._link.exchange(self.telegram(_POINT, position, quaternion), announce=announce)
        except OrderRefused:
            self._last = before
            raise

    async def halt(self) -> None:
        """Stand still at once and forget all points, for a robot that does not go where it was ordered to. Nothing can
        be ordered afterwards.
        """
        self.halted = True
        await self._link.order(stop_program())

    def abandon(self) -> None:
        """Order nothing more: the robot does not answer."""
        self.abandoned = True

    async def end(self) -> None:
        """End the sequence at the last point ordered, unless it was halted or abandoned."""
        if not (self.halted or self.abandoned):
            await self._link.order(self.telegram(MoveKind.END, *(self._last or ())))
