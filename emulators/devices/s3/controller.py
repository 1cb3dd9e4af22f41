"""S3 controller as an external system sees it: a computer link, a panel, and the faults of both.

Source: project specification of the computer link, sections 3 and 5.
"""

import contextlib
import math
import random
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from emulators.devices.s3.executive import Executive, Order
from emulators.devices.s3.faults import S3_FAULTS
from emulators.devices.s3.line import FaultyLine, Strike
from emulators.devices.s3.profile import S3Profiles
from emulators.devices.s3.programs import ProgramRun
from emulators.devices.s3.site import EMPTY_SITE, S3Site
from emulators.devices.s3.state import State, Stimulus
from emulators.devices.s3.stiffness import JOINT_STIFFNESS, MODE
from emulators.faults.ledger import Handler, Injection, Ledger, target_of
from emulators.faults.packets import BYTES, WIRE, Packets
from emulators.orders import Act, Hindrance, Orders, Reach, ReceivedOrder
from emulators.quantiles import draw
from emulators.seams import ArmPath, StartPose
from emulators.target_times import TargetTimes
from protocol.devices.s3.adlp import MessageReceived
from protocol.devices.s3.arap import (
    FunctionCode,
    Move,
    MoveKind,
    Refusal,
    Spontaneous,
    SpontaneousKind,
    Telegram,
    TelegramType,
    function_text,
    join_blocks,
    split_telegram,
)
from protocol.endpoint import LocalProtocolError, RemoteProtocolError
from protocol.geometry import Pose, normalise
from protocol.kinematics import Joints

_OFFSET_LIMIT = 0.1
"""Maximum offset of the encoders, m. Chosen: a measured position always fits the status."""


@dataclass(slots=True)
class Tally:
    """Numbers of orders so far."""

    answered: int = 0
    refused: int = 0
    lost: int = 0
    """Number of orders received while too many orders were waiting."""
    last_refusal: str = ""
    """Order, code and reason of the newest refusal."""


class S3Controller:
    """Controller behind its line, which is `endpoint`. It receives and sends bytes and has no events.

    Raises ValueError for a start outside the work area, or for a program with an invalid line.
    """

    def __init__(
        self,
        profiles: S3Profiles,
        start: StartPose,
        powered_at: float,
        seed: int,
        site: S3Site = EMPTY_SITE,
    ) -> None:
        self.profile = profile = profiles.robot
        self._servo = profiles.servo
        self._executive = Executive(profiles, start, powered_at, site)
        self.unmodelled = self._executive.unmodelled
        self.motion = self._executive.motion
        """True and reported position of the tool centre point."""
        self.orders = Orders()
        """Orders of motion, reported when they are answered, for a judge of the client."""
        self.tally = Tally()
        """Numbers of orders so far."""
        self._max_telegram = profiles.link.max_telegram
        self._line = FaultyLine(profiles.link, profile.spontaneous_eot, seed, self._restart)
        self._random = random.Random(seed)
        self._orders: deque[Order] = deque()
        self._ready_at: float | None = None
        """Time at which a starting controller becomes ready, s."""
        self.endpoint: Packets[bytes] = Packets(self, BYTES, f"{seed} link")
        """Controller's end of the computer link. It applies the faults of the line."""
        self._late: Injection | None = None
        """Fault that delays the next answer."""
        self._refuse: Injection | None = None
        """Fault that refuses the next orders."""
        self._frozen: list[Injection] = []
        self._restarts: Injection | None = None
        """Fault that interrupts the power within a message."""
        self.handlers: Mapping[str, Mapping[str, Handler]] = {
            "robot": {**self._robot_handlers(), **self._executive.reporting.mode_handlers},
            "pose": {
                "encoder-offset": Handler(self._offset_encoders, self._mend_encoders),
                **self._executive.reporting.pose_handlers,
            },
            WIRE: {**self.endpoint.handlers, **self._line_handlers()},
        }
        """Fault handlers of the controller, by target, for a ledger."""
        self.faults = Ledger(S3_FAULTS)
        """Ledger of faults, for a controller that is used without a cell."""
        for target, handlers in self.handlers.items():
            self.faults.attach(target, handlers)

    @property
    def state(self) -> State:
        """State that decides which orders are accepted."""
        return self._executive.state

    @property
    def program(self) -> ProgramRun | None:
        """Program that was started last."""
        return self._executive.run

    @property
    def armed(self) -> Mapping[str, int]:
        """Armed faults by name, each with the remaining number of times that it will occur."""
        waiting = {**self._line.armed}
        if self._late is not None:
            waiting["late-answer"] = 1
        if self._refuse is not None:
            waiting["refuses"] = int(self._refuse.number("count")) - self._refuse.struck
        return waiting

    def joints(self, now: float) -> Joints:
        """Return axes 1 to 6 of the true tool pose at `now`, rad.

        Where the servo overshoots the end of a range, return the axes of the set point.
        """
        return self._executive.joints(now)

    # --- as a cell knows it, see `emulators.seams.EmulatedRobot`

    @property
    def path(self) -> ArmPath:
        """Path of the arm."""
        return self.motion.path

    @property
    def targets(self) -> TargetTimes:
        """Times of the points."""
        return self.motion.path.targets

    def joints_holding(self, pose: Pose, at: float) -> Joints:
        """Return axes 1 to 6 for a true tool pose at the time `at`, s, rad. The motion must be known up to that
        time.
        """
        return self._executive.joints_holding(pose, at)

    def tool_pose_at(self, joints: Joints) -> Pose:
        """Return the pose of the tool, as `emulators.seams.ArticulatedRobot` specifies."""
        return self._executive.tool_pose_at(joints)

    joint_stiffness, mode = JOINT_STIFFNESS, MODE
    """Joint stiffness and mode, as `emulators.seams.ArticulatedRobot` specifies."""

    def hindrance(self, now: float) -> Hindrance | None:
        """Return the reason why the controller accepts no points now."""
        state = self.state
        reasons = {
            "the emergency stop is pressed": state.emergency_stop,
            "the work stop is on": state.work_stop,
            "the key is at MANUAL": not state.key_auto,
            "the link has no control": not state.link_control,
            "it is in standby": not state.operation,
        }
        reason = next((text for text, holds in reasons.items() if holds), "")
        return Hindrance(reason, False) if reason else None

    # --- endpoint

    def receive(self, data: bytes, now: float) -> None:
        """Receive bytes from the line."""
        self._line.receive(data, now)
        self._take_messages(now)

    def next_event(self) -> None:
        """Return None: a controller has no events."""

    def data_to_send(self, now: float) -> bytes:
        """Return bytes for the line."""
        return self._line.data_to_send(now)

    def next_deadline(self) -> float | None:
        """Return the time of the next link timeout, order, program step or end of the start-up, s."""
        due = self._line.next_deadline()
        order = self._orders[0].due if self._orders else None
        for at in (order, self._executive.next_deadline(), self._ready_at):
            if at is not None and (due is None or at < due):
                due = at
        return due

    def handle_deadline(self, now: float) -> None:
        """Process the link's timeouts, continue the program and answer all orders that are due."""
        if self._ready_at is not None and self._ready_at <= now:
            self._ready_at = None
            self._executive.apply_event(Stimulus.READY, now)
        self._line.handle_deadline(now)
        self._take_messages(now)
        if (error := self._executive.handle_deadline(now)) is not None:
            self._say(error.to_telegram())
        while self._orders and self._orders[0].due <= now:
            order = self._orders[0]
            answer = self._answer(order, now)
            if answer is None:
                order.due = self.motion.next_tick()
                return
            self._orders.popleft()
            self._say(answer)

    # --- acts of people at the robot

    def press_emergency_stop(self, now: float) -> None:
        """Stop motion and program, enter standby, and report to the PC."""
        if self.state.emergency_stop:
            return
        self._executive.apply_event(Stimulus.EMERGENCY_STOP, now)
        error = Spontaneous(SpontaneousKind.OPERATIONAL_ERROR, *self.profile.emergency_stop_error)
        self._say(error.to_telegram())

    def release_emergency_stop(self, now: float) -> None:
        """Permit operation mode again. An order must then select it."""
        self._executive.apply_event(Stimulus.EMERGENCY_RELEASE, now)

    def set_work_stop(self, active: bool, now: float) -> None:
        """Stop motion and program while `active`. The mode does not change."""
        self._executive.apply_event(Stimulus.WORK_STOP if active else Stimulus.WORK_RELEASE, now)

    def set_key(self, auto: bool, now: float) -> None:
        """Turn the key to AUTO or MANUAL. In MANUAL, orders neither move the arm nor run a program."""
        self._executive.apply_event(Stimulus.KEY_AUTO if auto else Stimulus.KEY_MANUAL, now)

    def set_link_control(self, active: bool, now: float) -> None:
        """Give control to the link at the pendant, or withdraw it. A motion continues."""
        self._executive.apply_event(Stimulus.CONTROL_GRANTED if active else Stimulus.CONTROL_WITHDRAWN, now)

    def set_programming_unit(self, connected: bool, now: float) -> None:
        """Connect or remove the programming unit. This affects only the status."""
        self._executive.apply_event(Stimulus.UNIT_CONNECTED if connected else Stimulus.UNIT_REMOVED, now)

    def set_interrupt(self, permitted: bool, now: float) -> None:
        """Permit or forbid interrupts. This affects only the status."""
        self._executive.apply_event(
            Stimulus.INTERRUPT_PERMITTED if permitted else Stimulus.INTERRUPT_FORBIDDEN, now
        )

    def inject(self, fault: str, now: float, **parameters: object) -> Injection:
        """Inject one fault of `S3_FAULTS` now, or at its next opportunity. Raises ValueError for an invalid fault."""
        return self.faults.inject(target_of(fault, S3_FAULTS), fault, now, parameters)

    def disarm(self) -> None:
        """Cancel all armed faults. Active faults continue."""
        self._line.disarm()
        self._late = self._refuse = self._restarts = None

    # --- faults

    def _robot_handlers(self) -> dict[str, Handler]:
        return {
            "emergency-stop": self._lever(
                S3Controller.press_emergency_stop, S3Controller.release_emergency_stop
            ),
            "safeguard-stop": self._lever(
                lambda robot, now: robot.set_work_stop(True, now),
                lambda robot, now: robot.set_work_stop(False, now),
            ),
            "key-manual": self._lever(
                lambda robot, now: robot.set_key(False, now), lambda robot, now: robot.set_key(True, now)
            ),
            "local-control": self._lever(
                lambda robot, now: robot.set_link_control(False, now),
                lambda robot, now: robot.set_link_control(True, now),
            ),
            "motors-off": self._lever(lambda robot, now: robot._executive.apply_event(Stimulus.STANDBY, now)),
            "late-answer": Handler(self._answer_late),
            "refuses": Handler(self._refuse_next),
            "spontaneous": Handler(self._send_unsolicited),
            "power-cycle": Handler(self._power_cycle),
            "stands": Handler(self._freeze, lambda injection, now: self.motion.freeze(now, now)),
        }

    def _line_handlers(self) -> dict[str, Handler]:
        line = self._line
        return {
            "drop-ack": Handler(self._drop_ack),
            "nak-block": Handler(lambda injection: line.arm(Strike.DAMAGE_BLOCK, injection)),
            "corrupt-block": Handler(lambda injection: line.arm(Strike.CORRUPT_BLOCK, injection)),
            "lose-eot": Handler(lambda injection: line.arm(Strike.LOSE_EOT, injection)),
            "babble": Handler(self._babble),
            "line-break": Handler(line.hold_in_break, line.switch_on),
        }

    def _lever(
        self,
        press: Callable[["S3Controller", float], object],
        release: Callable[["S3Controller", float], object] | None = None,
    ) -> Handler:
        """Return the handler for an operator's action at the panel. The fault takes effect if the action changes
        the state.
        """

        def begin(injection: Injection) -> None:
            before, now = self.state, injection.injected_at
            press(self, now)
            injection.struck += self.state != before
            if release is None:
                injection.finish(now)

        return Handler(begin, None if release is None else lambda injection, now: release(self, now))

    def _drop_ack(self, injection: Injection) -> None:
        block = injection.values["of"] == "block"
        self._line.arm(Strike.DROP_BLOCK_ACK if block else Strike.DROP_BID_ACK, injection)

    def _babble(self, injection: Injection) -> None:
        injection.struck = int(injection.number("count"))
        self._line.babble(injection.struck)
        injection.finish(injection.injected_at)

    def _answer_late(self, injection: Injection) -> None:
        self._late = injection

    def _refuse_next(self, injection: Injection) -> None:
        self._refuse = injection

    def _send_unsolicited(self, injection: Injection) -> None:
        kind, x, y = (int(injection.number(key)) for key in ("kind", "x", "y"))
        injection.struck += not self.state.starting
        self._say(Spontaneous(kind, x, y).to_telegram())
        injection.finish(injection.injected_at)

    def _freeze(self, injection: Injection) -> None:
        assert injection.ends_at is not None
        now = injection.injected_at
        injection.struck += self.motion.waiting(now) > 0
        self._frozen.append(injection)
        self.motion.freeze(now, injection.ends_at)

    def _power_cycle(self, injection: Injection) -> None:
        self._restarts = injection
        if after_bytes := int(injection.number("after_bytes")):
            self._line.reset_after(after_bytes)
        else:
            self._restart(injection.injected_at)

    def _restart(self, now: float) -> None:
        """Restart the controller, which is silent at first. Its disc and arm are unchanged."""
        self._executive.apply_event(Stimulus.POWER_UP, now)
        self._orders.clear()
        self._ready_at = now + self.profile.start_up_s
        self._line.restart(self._ready_at)
        if (injection := self._restarts) is not None:
            self._restarts = None
            injection.struck += 1
            injection.finish(now)

    def _offset_encoders(self, injection: Injection) -> None:
        x, y, z = (injection.number(f"{axis}_mm") / 1000.0 for axis in "xyz")
        total = [before + by for before, by in zip(self.motion.encoder_offset, (x, y, z), strict=True)]
        if max(map(abs, total)) > _OFFSET_LIMIT:
            raise ValueError(
                f"encoder-offset: all offsets together must stay within ±{_OFFSET_LIMIT * 1e3:g} mm"
            )
        injection.struck += 1
        self.motion.offset_encoders((x, y, z), injection.injected_at)

    def _mend_encoders(self, injection: Injection, now: float) -> None:
        x, y, z = (-injection.number(f"{axis}_mm") / 1000.0 for axis in "xyz")
        self.motion.offset_encoders((x, y, z), now)

    # --- orders and answers

    def _take_messages(self, now: float) -> None:
        while (event := self._line.next_event()) is not None:
            if isinstance(event, MessageReceived):
                self._take_message(event.telegrams, now)

    def _take_message(self, telegrams: tuple[bytes, ...], now: float) -> None:
        """Accept an order that consists of one or several blocks."""
        if len(self._orders) >= self.profile.order_backlog:
            self.tally.lost += 1
            return
        try:
            telegram = join_blocks([Telegram.decode(raw, from_robot=False) for raw in telegrams])
            function = telegram.function
        except RemoteProtocolError:
            raw = telegrams[0]
            telegram, function = None, raw[4] if len(raw) > 4 else 0
        due = now + self._turnaround_ms(function) / 1000.0
        if (late := self._late) is not None:
            self._late = None
            due += late.number("seconds")
            late.struck += 1
            late.finish(now)
        self._orders.append(Order(telegram, function, due, len(telegrams), arrived_at=now))

    def _turnaround_ms(self, function: int) -> float:
        """Return the time from an order to its answer, ms. One random number is drawn for each order."""
        profile = self.profile
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

    def _answer(self, order: Order, now: float) -> Telegram | None:
        """Return the answer to an order; None while the answer is not due."""
        answer: Telegram | int | None
        refuse = self._refuse
        if refuse is not None and refuse.number("function") in (0, order.function):
            answer = int(refuse.number("code"))
            refuse.strike(now)
            if refuse.ended_at is not None:
                self._refuse = None
        else:
            answer = self._executive.judge(order, now)
        if answer is None:
            return None
        for frozen in self._frozen:
            frozen.struck += frozen.holds(now) and order.function == FunctionCode.MOVE
        self.tally.answered += 1
        if self.orders.listener is not None:
            self._report_order(order, answer)
        if isinstance(answer, Telegram):
            return answer
        refusal = Refusal(answer)
        self.tally.refused += 1
        self.tally.last_refusal = f"{function_text(order.function)}: {answer:d} {refusal.text}"
        return refusal.to_telegram(order.telegram or Telegram(order.function, TelegramType.ORDER))

    def _report_order(self, order: Order, answer: Telegram | int) -> None:
        """Report an order of motion and its answer to a judge, with the time at which the order was received."""
        now = order.arrived_at
        accepted = isinstance(answer, Telegram)
        if order.telegram is None:
            self.orders.tell(ReceivedOrder(now, Act.UNREADABLE, function_text(order.function), accepted))
        elif order.function == FunctionCode.START_PROGRAM:
            self.orders.tell(ReceivedOrder(now, Act.PROGRAM, "start program", accepted))
        elif order.function == FunctionCode.MOVE and order.telegram.suffix != MoveKind.START:
            self._report_move(self._executive.move_of(order.telegram), accepted, now)
        else:
            act = Act.REFUSED if self._executive.is_not_emulated(order.function) else Act.CONTACT
            self.orders.tell(ReceivedOrder(now, act, function_text(order.function), accepted))

    def _report_move(self, move: Move | None, taken: bool, now: float) -> None:
        """Report a move to a judge. The move includes a speed, and the robot plans the path."""
        pose, reach, norm = None, None, 0.0
        if move is not None:
            norm = math.hypot(*move.quaternion)
            servo = self._servo
            speed, turn = move.velocity * move.run_speed, math.radians(servo.reorientation_deg_s)
            reach = Reach(servo.interpolation_ms * 1e-3, speed, turn, plans_own_path=True)
            pose = Pose(move.position, normalise(move.quaternion) if norm else move.quaternion)
        self.orders.tell(ReceivedOrder(now, Act.MOTION, "move", taken, pose, norm > 0.0, reach))

    def _say(self, telegram: Telegram) -> None:
        if self.state.starting:
            return
        # A full queue means that the host has not read for many timeouts: one more telegram is useless.
        with contextlib.suppress(LocalProtocolError):
            self._line.send([block.encode() for block in split_telegram(telegram, self._max_telegram)])
