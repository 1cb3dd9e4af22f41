"""Orders of the S3 controller: its state, arm and programs, without a link and without delay.

The tables of `emulators.devices.s3.state` define the orders that a state refuses, and the events that change it.
Source: project specification of the computer link, section 3.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from emulators.arm.waypoints import Waypoint, WaypointArm
from emulators.arm.work_area import OutsideWorkArea, WorkArea
from emulators.devices.s3.profile import S3Profile, S3Profiles
from emulators.devices.s3.programs import MoveStep, ProgramRun, Step, WaitStep, read_steps
from emulators.devices.s3.reporting import Reporting
from emulators.devices.s3.site import S3Site, SiteOrders
from emulators.devices.s3.state import (
    CHANGES,
    MODE_ORDERS,
    Stimulus,
    after,
    initial,
    refusal,
    status_flags,
)
from emulators.seams import StartPose
from emulators.unmodelled import Unmodelled
from protocol.devices.s3.arap import (
    MOVE_LENGTHS,
    FunctionCode,
    Mode,
    Move,
    MoveKind,
    ProgramAnswer,
    RefusalCode,
    Spontaneous,
    SpontaneousKind,
    Status,
    Telegram,
    TelegramType,
    position_words,
    quaternion_words,
    response,
)
from protocol.endpoint import RemoteProtocolError
from protocol.geometry import Pose, Quaternion, Vector, normalise
from protocol.kinematics import Joints

_UNIT_TOLERANCE = 0.01
"""Tolerance of a quaternion's norm. Assumed; rounding to 1/16384 alone causes 0.0001."""

_LOOK_AHEAD_S = 0.14
"""Time for which the path is computed ahead, s. Chosen: the time between two move orders on a link of 9600 baud.
The transport delay is subtracted, since that part of the path is committed anyway. Computing beyond the next order
is wasted.
"""

_REAL = frozenset(FunctionCode)
"""Function codes of a real controller."""
Answer: TypeAlias = Telegram | int | None
"""Response or refusal code; None if there is no answer yet."""


@dataclass(slots=True)
class Order:
    """Order that has arrived and is not answered yet."""

    telegram: Telegram | None
    """Telegram of the order; None if it is unreadable."""
    function: int
    due: float
    """Time of the order's next check, s."""
    blocks: int = 1
    """Number of blocks of the order."""
    waypoint: Waypoint | None = None
    """Target of a move; None until the complete line to it has been checked to be in the work area."""
    accepted: bool = False
    """Whether the order is a queued move whose answer waits until the point is reached."""
    arrived_at: float = math.nan
    """Time at which the order arrived, s."""


class Executive:
    """Processes orders one after the other, and runs programs.

    Raises ValueError for a start outside the work area, or for a program with an invalid line.
    """

    def __init__(
        self,
        profiles: S3Profiles,
        start: StartPose,
        powered_at: float,
        site: S3Site,
    ) -> None:
        self._profile = profile = profiles.robot
        self.unmodelled = Unmodelled("s3")
        self._site = site
        self._site_orders = SiteOrders(site.orders)
        self._programs = _read_programs(profile, site)
        self._move_lengths = frozenset((*MOVE_LENGTHS, profiles.link.move_length))
        self._work_area = WorkArea(profile, start.tool_length)
        self.tool_pose_at = self._work_area.pose
        """Returns the pose of the tool at joint angles, rad."""
        try:
            joints = self._work_area.joints(start.position, normalise(start.quaternion))
        except OutsideWorkArea as error:
            raise ValueError(
                f"the start position {start.position} m with the quaternion {start.quaternion} is outside the "
                f"robot's work area: {error}"
            ) from None
        self.motion = WaypointArm(
            profiles.servo, Pose(start.position, start.quaternion), powered_at, joints, _LOOK_AHEAD_S
        )
        """True and reported position of the tool centre point."""
        self.reporting = Reporting(self.motion)
        """Faults of the reported values."""
        self.state = initial(profile)
        """State that decides which orders are accepted."""
        self.run: ProgramRun | None = None
        """Program that was started last."""
        self._handlers: dict[int, Callable[[Order, Telegram, float], Answer]] = {
            FunctionCode.START_PROGRAM: self._start_program,
            FunctionCode.STOP_PROGRAM: self._stop_program,
            FunctionCode.READ_STATUS: self._read_status,
            FunctionCode.WRITE_MODE: self._write_mode,
            FunctionCode.MOVE: self._move,
            FunctionCode.RECEIVE_PROGRAM: self._receive_program,
        }

    def joints(self, now: float) -> Joints:
        """Return axes 1 to 6 of the true tool pose at `now`, rad.

        Where the servo overshoots the end of a range, return the axes of the set point.
        """
        x, y, z = self.motion.path.trajectory(np.array([now]))[0][0].tolist()
        return self.joints_holding(Pose((x, y, z), self.motion.path.orientation(now)), now)

    def joints_holding(self, pose: Pose, at: float) -> Joints:
        """Return axes 1 to 6 for a true tool pose at the time `at`, s, rad.

        The pose has a unit quaternion, and the motion must be known up to that time. Where the servo overshoots the
        end of a range, return the axes of the set point.
        """
        set_point = self.motion.joints(at)
        try:
            return self._work_area.joints(pose.position, pose.quaternion, set_point)
        except OutsideWorkArea:
            return set_point

    def apply_event(self, stimulus: Stimulus, now: float) -> None:
        """Apply an event to the state. Stop the arm and the program as the table of events requires."""
        self.state = after(self.state, stimulus, self._profile)
        if CHANGES[stimulus].halts:
            self.motion.halt(now)
            if self.run is not None:
                self.run.stop()
        if stimulus is Stimulus.POWER_UP:
            self.run = None

    def status(self, now: float) -> Status:
        """Return the answer to an order that reads the status."""
        run = self.run
        status = Status(
            position_words(self.motion.reported(now)),
            quaternion_words(self.motion.path.orientation(now)),
            program=run.number if run is not None else 0,
            instruction=run.instruction if run is not None else 0,
            **status_flags(self.state, self.motion.waiting(now) > 0, self._profile),
        )
        return self.reporting.falsified(status, now)

    # --- programs

    def next_deadline(self) -> float | None:
        """Return the time of the next check of the running program, s."""
        return self.run.due if self.run is not None else None

    def handle_deadline(self, now: float) -> Spontaneous | None:
        """Continue the running program. Return the error that ended it, or None."""
        run = self.run
        if run is None or run.due is None:
            return None
        try:
            run.advance(now, self.motion, self._program_moves)
        except OutsideWorkArea:
            self.apply_event(Stimulus.STOP, now)
            return Spontaneous(SpontaneousKind.OPERATIONAL_ERROR, *self._profile.program_error)
        if run.ended:
            self.apply_event(Stimulus.PROGRAM_END, now)
        return None

    def _program_moves(self, step: MoveStep, now: float) -> None:
        _, quaternion, _ = self.motion.goal(now)
        self.motion.enqueue(self._waypoint(step.position, quaternion, step.speed, now), now)

    # --- orders

    def judge(self, order: Order, now: float) -> Answer:
        """Apply the rules for all orders, then the handler for this one."""
        telegram = order.telegram
        if telegram is None:
            return RefusalCode.TELEGRAM_INCOMPLETE
        definition = self._site.orders.of_function(telegram.function)
        if self.is_not_emulated(telegram.function):
            text = FunctionCode(telegram.function).text
            self.unmodelled.touch(
                f"function {telegram.function}, {text}", "refused; an orders file can define it"
            )
        if definition is None or telegram.type != TelegramType.ORDER:
            return RefusalCode.WRONG_FUNCTION_CODE
        if telegram.suffix not in definition.suffixes:
            return RefusalCode.WRONG_SUFFIX
        if order.blocks > 1 and definition.blocks == "one":
            return RefusalCode.WRONG_BLOCK_NUMBER
        if len(telegram.data) < definition.order.layout.size:
            return RefusalCode.TELEGRAM_INCOMPLETE
        refused = refusal(self.state, telegram.function, telegram.suffix, self._profile, order.accepted)
        if refused is not None:
            return refused
        handler = self._handlers.get(telegram.function)
        if handler is None:
            return self._site_orders.answer(definition, telegram)
        answer = handler(order, telegram, now)
        return self._site_orders.extend(telegram, answer) if isinstance(answer, Telegram) else answer

    def _read_status(self, order: Order, telegram: Telegram, now: float) -> Answer:
        return self.status(now).to_telegram()

    def _write_mode(self, order: Order, telegram: Telegram, now: float) -> Answer:
        self.apply_event(MODE_ORDERS[Mode(telegram.suffix)], now)
        return response(telegram)

    def _start_program(self, order: Order, telegram: Telegram, now: float) -> Answer:
        """Start or continue a program. Assumed: only the program that was started last can continue, and only if it
        has not ended.
        """
        number = int.from_bytes(telegram.data[:2], "big")
        steps = self._programs.get(number)
        if steps is None:
            return RefusalCode.WRONG_PROGRAM_NUMBER
        if telegram.suffix == 0:
            self.run = ProgramRun(number, steps)
        elif self.run is None or self.run.number != number:
            return RefusalCode.WRONG_PROGRAM_NUMBER
        elif self.run.ended:
            return RefusalCode.NOT_POSSIBLE
        self.run.start(now)
        self.apply_event(Stimulus.PROGRAM_START, now)
        return response(telegram)

    def _stop_program(self, order: Order, telegram: Telegram, now: float) -> Answer:
        self.apply_event(Stimulus.STOP, now)
        return response(telegram)

    def _receive_program(self, order: Order, telegram: Telegram, now: float) -> Answer:
        """Send the contents of a program. They are empty if only the program's number is known."""
        number = int.from_bytes(telegram.data[:2], "big")
        if number not in self._site.programs:
            return RefusalCode.NO_SUCH_PROGRAM
        return ProgramAnswer(number, self._site.programs[number]).to_telegram()

    def is_not_emulated(self, function: int) -> bool:
        """Return whether a real controller has this function but the emulated one does not."""
        return function in _REAL and self._site.orders.of_function(function) is None

    def move_of(self, telegram: Telegram) -> Move | None:
        """Return the move in an order; None if it is unreadable."""
        try:
            return Move.from_telegram(telegram, self._move_lengths)
        except RemoteProtocolError:
            return None

    def _move(self, order: Order, telegram: Telegram, now: float) -> Answer:
        if not order.accepted:
            try:
                move = Move.from_telegram(telegram, self._move_lengths)
            except RemoteProtocolError:
                return RefusalCode.TELEGRAM_INCOMPLETE
            if move.kind is MoveKind.START:
                self.apply_event(Stimulus.SEQUENCE_START, now)
                return response(telegram)
            if move.robot_coordinates:
                self.unmodelled.touch("points in robot coordinates", "refused")
            if not _usable(move):
                return self._profile.unusable_move_refusal
            if order.waypoint is None:
                # Everything that changes the goal while the order waits for a free place also ends the sequence.
                try:
                    order.waypoint = self._waypoint(
                        move.position, move.quaternion, move.velocity * move.run_speed, now
                    )
                except OutsideWorkArea:
                    return RefusalCode.OUTSIDE_WORK_AREA
            if self.motion.waiting(now) >= self._profile.queue_depth:
                return None
            self.motion.enqueue(order.waypoint, now)
            if move.kind is MoveKind.END:
                self.apply_event(Stimulus.SEQUENCE_END, now)
            order.accepted = True
        if self._profile.move_reply == "reached" and not self.motion.settled(now):
            return None
        return response(telegram)

    def _waypoint(self, position: Vector, quaternion: Quaternion, speed: float, now: float) -> Waypoint:
        """Return a waypoint with the line to it from the last accepted point. Raises OutsideWorkArea."""
        route = self._work_area.route(*self.motion.goal(now), position, normalise(quaternion))
        return Waypoint(position, quaternion, speed, route)


def _usable(move: Move) -> bool:
    """Return whether a point has a speed, rectangular coordinates, and a unit quaternion."""
    unit = abs(math.hypot(*move.quaternion) - 1.0) <= _UNIT_TOLERANCE
    return unit and not move.robot_coordinates and move.velocity * move.run_speed > 0.0


def _read_programs(profile: S3Profile, site: S3Site) -> dict[int, tuple[Step, ...]]:
    """Return steps by program number. Raises ValueError that names the program and the line."""
    programs: dict[int, tuple[Step, ...]] = {}
    for number in (*profile.programs, *site.programs):
        try:
            steps = read_steps(site.programs.get(number, b""))
        except ValueError as error:
            raise ValueError(f"program {number}: {error}") from None
        programs[number] = steps or (WaitStep(profile.program_s),)
    return programs
