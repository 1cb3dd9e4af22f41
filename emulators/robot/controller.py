"""The S3 controller behind its computer link: one order at a time, an answer or a refusal to each.

Source: project specification of the computer link, sections 3 and 5. Conditions of refusals are assumed,
their codes are observed.
"""

import contextlib
import math
import random
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from emulators.quantiles import draw
from emulators.robot.kinematics import Joints
from emulators.robot.motion import Motion, ServoProfile, Waypoint, normalised
from emulators.robot.profile import S3Profile
from emulators.robot.site import EMPTY_SITE, S3Site, SiteOrders
from emulators.robot.work_area import OutsideWorkArea, WorkArea
from protocol.adlp import Link, LinkProfile, MessageReceived, Role
from protocol.arap import (
    MOVE_LENGTHS,
    FunctionCode,
    Mode,
    Move,
    MoveKind,
    ProgramAnswer,
    Quaternion,
    Refusal,
    RefusalCode,
    Spontaneous,
    SpontaneousKind,
    Status,
    Telegram,
    TelegramType,
    Vector,
    join_blocks,
    position_words,
    quaternion_words,
    response,
    split_telegram,
)
from protocol.endpoint import LocalProtocolError, RemoteProtocolError

_UNIT_TOLERANCE = 0.01
"""Assumed: how far a quaternion's norm may be from 1; words of 1/16384 alone make up 0.0001."""

_Answer: TypeAlias = Telegram | int | None
"""A response, a refusal code, or None: not yet."""


@dataclass(slots=True)
class _Order:
    telegram: Telegram | None
    """None for one that could not be read."""
    function: int
    due: float
    """When it is next looked at, s."""
    blocks: int = 1
    """How many it came in."""
    waypoint: Waypoint | None = None
    """Where a move leads to, once the whole line is known to be in the work area."""
    accepted: bool = False
    """A move that is queued and waits to be reached."""


class S3Controller:
    """Endpoint of the robot's end of the computer link; takes and gives bytes, tells no events.

    Raises ValueError for a start outside the work area.
    """

    def __init__(
        self,
        profile: S3Profile,
        link_profile: LinkProfile,
        servo_profile: ServoProfile,
        start_position: Vector,
        start_quaternion: Quaternion,
        powered_at: float,
        seed: int,
        tool_length: float = 0.0,
        site: S3Site = EMPTY_SITE,
    ) -> None:
        self._profile = profile
        self._site = site
        self._site_orders = SiteOrders(site.orders)
        self._programs = {*profile.programs, *site.programs}
        self._max_telegram = link_profile.max_telegram
        self._link = Link(Role.ROBOT, link_profile)
        self._work_area = WorkArea(profile, tool_length)
        self._move_lengths = frozenset((*MOVE_LENGTHS, link_profile.move_length))
        try:
            joints = self._work_area.joints(start_position, normalised(start_quaternion))
        except OutsideWorkArea as error:
            raise ValueError(
                f"the start position {start_position} m with the quaternion {start_quaternion} is outside the "
                f"robot's work area: {error}"
            ) from None
        self.motion = Motion(servo_profile, start_position, start_quaternion, powered_at, joints)
        """True and reported place of the tool centre point."""
        self._random = random.Random(seed)
        self._orders: deque[_Order] = deque()
        self._mode = Mode(profile.power_up_mode)
        self._link_control = profile.link_control
        self._emergency_stop = False
        self._work_stop = False
        self._in_sequence = False
        self._program = 0
        self._program_runs = False
        self._handlers: dict[int, Callable[[_Order, Telegram, float], _Answer]] = {
            FunctionCode.START_PROGRAM: self._start_program,
            FunctionCode.STOP_PROGRAM: self._stop_program,
            FunctionCode.READ_STATUS: self._read_status,
            FunctionCode.WRITE_MODE: self._write_mode,
            FunctionCode.MOVE: self._move,
            FunctionCode.RECEIVE_PROGRAM: self._receive_program,
        }

    def joints(self, now: float) -> Joints:
        """Axes 1 to 6 of the true tool pose at `now`, rad; those of the set point where the servo swings beyond
        the end of a range.
        """
        x, y, z = self.motion.trajectory(np.array([now]))[0][0].tolist()
        set_point = self.motion.joints(now)
        try:
            return self._work_area.joints((x, y, z), self.motion.orientation(now), set_point)
        except OutsideWorkArea:
            return set_point

    # --- endpoint

    def receive(self, data: bytes, now: float) -> None:
        """Take bytes off the line."""
        self._link.receive(data, now)
        self._take_messages(now)

    def next_event(self) -> None:
        """A robot tells nothing to those who run it."""

    def data_to_send(self, now: float) -> bytes:
        """Bytes for the line."""
        return self._link.data_to_send(now)

    def next_deadline(self) -> float | None:
        """The link's next time-out, or when the oldest order is next looked at."""
        link = self._link.next_deadline()
        order = self._orders[0].due if self._orders else None
        return min((at for at in (link, order) if at is not None), default=None)

    def handle_deadline(self, now: float) -> None:
        """Act on the link's time-outs and answer what is due."""
        self._link.handle_deadline(now)
        self._take_messages(now)
        while self._orders and self._orders[0].due <= now:
            order = self._orders[0]
            answer = self._answer(order, now)
            if answer is None:
                order.due = self.motion.next_tick()
                return
            self._orders.popleft()
            self._say(answer)

    # --- what people do at the robot

    def press_emergency_stop(self, now: float) -> None:
        """Stop moving and running, fall into standby, tell the PC."""
        self._emergency_stop = True
        self._mode = Mode.STANDBY
        self._stop_all(now)
        error = Spontaneous(SpontaneousKind.OPERATIONAL_ERROR, *self._profile.emergency_stop_error)
        self._say(error.to_telegram())

    def release_emergency_stop(self) -> None:
        """Allow operation again; assumed: it has to be ordered anew."""
        self._emergency_stop = False

    def set_work_stop(self, active: bool, now: float) -> None:
        """Stop moving and running while `active`; the mode stays."""
        self._work_stop = active
        if active:
            self._stop_all(now)

    def set_link_control(self, given: bool) -> None:
        """Give the link control at the pendant, or take it back; what moves goes on."""
        self._link_control = given

    # --- orders

    def _take_messages(self, now: float) -> None:
        while (event := self._link.next_event()) is not None:
            if isinstance(event, MessageReceived):
                self._take_message(event.telegrams, now)

    def _take_message(self, telegrams: tuple[bytes, ...], now: float) -> None:
        """Note an order, of one block or several."""
        if len(self._orders) >= self._profile.order_backlog:
            return
        try:
            telegram = join_blocks([Telegram.decode(raw, from_robot=False) for raw in telegrams])
            function = telegram.function
        except RemoteProtocolError:
            raw = telegrams[0]
            telegram, function = None, raw[4] if len(raw) > 4 else 0
        self._orders.append(
            _Order(telegram, function, now + self._turnaround_ms(function) / 1000.0, len(telegrams))
        )

    def _turnaround_ms(self, function: int) -> float:
        """What it takes to come to answering this order; one number is drawn for each."""
        profile = self._profile
        measured: tuple[float, ...] = ()
        match function:
            case FunctionCode.READ_STATUS:
                measured = profile.status_turnaround_ms
            case FunctionCode.MOVE:
                measured = profile.move_turnaround_ms
        if measured:
            return draw(measured, self._random)
        spread = profile.turnaround_spread_ms
        return profile.turnaround_ms + self._random.uniform(-spread, spread)

    def _answer(self, order: _Order, now: float) -> Telegram | None:
        """What to say to an order, or None while its time has not come."""
        answer = self._judge(order, now)
        if not isinstance(answer, int):
            return answer
        return Refusal(answer).to_telegram(order.telegram or Telegram(order.function, TelegramType.ORDER))

    def _judge(self, order: _Order, now: float) -> _Answer:
        """What holds for every order; what holds for one is its handler's matter."""
        telegram = order.telegram
        if telegram is None:
            return RefusalCode.TELEGRAM_INCOMPLETE
        definition = self._site.orders.of_function(telegram.function)
        if definition is None or telegram.type != TelegramType.ORDER:
            return RefusalCode.WRONG_FUNCTION_CODE
        if telegram.suffix not in definition.suffixes:
            return RefusalCode.WRONG_SUFFIX
        if order.blocks > 1 and definition.blocks == "one":
            return RefusalCode.WRONG_BLOCK_NUMBER
        if len(telegram.data) < definition.order.layout.size:
            return RefusalCode.TELEGRAM_INCOMPLETE
        if not self._link_control and telegram.function != FunctionCode.READ_STATUS:
            return self._profile.no_control_refusal
        handler = self._handlers.get(telegram.function)
        if handler is None:
            return self._site_orders.answer(definition, telegram)
        answer = handler(order, telegram, now)
        return self._site_orders.extend(telegram, answer) if isinstance(answer, Telegram) else answer

    def _say(self, telegram: Telegram) -> None:
        # A full queue means that nobody has listened for many time-outs: one telegram more helps nobody.
        with contextlib.suppress(LocalProtocolError):
            self._link.send([block.encode() for block in split_telegram(telegram, self._max_telegram)])

    def _stop_all(self, now: float) -> None:
        self.motion.halt(now)
        self._in_sequence = False
        self._program_runs = False

    def _obstacle(self) -> RefusalCode | None:
        """Why nothing may move at present, or None."""
        if self._emergency_stop:
            return RefusalCode.STOPPED
        if self._work_stop:
            return RefusalCode.WORK_STOP
        if not self._mode & Mode.OPERATION:
            return RefusalCode.WRONG_OPERATION_MODE
        return None

    # --- one handler a function

    def _read_status(self, order: _Order, telegram: Telegram, now: float) -> _Answer:
        operation = bool(self._mode & Mode.OPERATION)
        return Status(
            position_words(self.motion.reported(now)),
            quaternion_words(self.motion.orientation(now)),
            program=self._program,
            local=not self._link_control,
            key_auto=True,
            standby=not operation,
            operation=operation,
            execution=self._program_runs or self.motion.waiting(now) > 0,
            emergency_stop=self._emergency_stop,
        ).to_telegram()

    def _write_mode(self, order: _Order, telegram: Telegram, now: float) -> _Answer:
        mode = Mode(telegram.suffix)
        if mode & Mode.OPERATION and self._emergency_stop:
            return RefusalCode.STOPPED
        self._mode = mode
        if not mode & Mode.OPERATION:
            self._stop_all(now)
        return response(telegram)

    def _start_program(self, order: _Order, telegram: Telegram, now: float) -> _Answer:
        number = int.from_bytes(telegram.data[:2], "big")
        goes_on = telegram.suffix == 1
        if (obstacle := self._obstacle()) is not None:
            return obstacle
        if self._program_runs:
            return RefusalCode.PROGRAM_RUNNING
        if number not in self._programs or (goes_on and number != self._program):
            return RefusalCode.WRONG_PROGRAM_NUMBER
        self._program, self._program_runs = number, True
        return response(telegram)

    def _stop_program(self, order: _Order, telegram: Telegram, now: float) -> _Answer:
        """Assumed: stops a movement sequence as well."""
        self._stop_all(now)
        return response(telegram)

    def _receive_program(self, order: _Order, telegram: Telegram, now: float) -> _Answer:
        """A program of which only the number is given has no contents to send."""
        number = int.from_bytes(telegram.data[:2], "big")
        if number not in self._site.programs:
            return RefusalCode.NO_SUCH_PROGRAM
        return ProgramAnswer(number, self._site.programs[number]).to_telegram()

    def _move(self, order: _Order, telegram: Telegram, now: float) -> _Answer:
        if (obstacle := self._obstacle()) is not None:
            return obstacle
        if not order.accepted:
            if self._program_runs:
                return RefusalCode.PROGRAM_RUNNING
            try:
                move = Move.from_telegram(telegram, self._move_lengths)
            except RemoteProtocolError:
                return RefusalCode.TELEGRAM_INCOMPLETE
            if move.kind is MoveKind.START:
                self._in_sequence = True
                return response(telegram)
            if (refusal := self._fault_of(move)) is not None:
                return refusal
            if order.waypoint is None:
                # Whatever changes the goal while the order waits for a place also ends the sequence.
                try:
                    order.waypoint = self._waypoint(move, now)
                except OutsideWorkArea:
                    return RefusalCode.OUTSIDE_WORK_AREA
            if self.motion.waiting(now) >= self._profile.queue_depth:
                return None
            self.motion.enqueue(order.waypoint, now)
            self._in_sequence = move.kind is not MoveKind.END
            order.accepted = True
        if self._profile.move_reply == "reached" and not self.motion.settled(now):
            return None
        return response(telegram)

    def _waypoint(self, move: Move, now: float) -> Waypoint:
        """Where a move leads to from the last point accepted. Raises OutsideWorkArea."""
        route = self._work_area.route(*self.motion.goal(now), move.position, normalised(move.quaternion))
        return Waypoint(move.position, move.quaternion, move.velocity * move.run_speed, route)

    def _fault_of(self, move: Move) -> int | None:
        """Why a point cannot be moved to, as a refusal code, or None."""
        if not self._in_sequence:
            return RefusalCode.OUTSIDE_WORK_AREA
        unit = abs(math.hypot(*move.quaternion) - 1.0) <= _UNIT_TOLERANCE
        if move.robot_coordinates or not unit or not move.velocity * move.run_speed > 0.0:
            return self._profile.unusable_move_refusal
        return None
