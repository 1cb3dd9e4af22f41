"""A KUKA controller whose program corrects its path by a sensor: RSI_CREATE, RSI_ON, RSI_MOVECORR.

It sends a telegram each cycle by its own clock and takes the answers. RSI_MOVECORR keeps a standing motion active, so
that the programmed pose stays where the program was begun. Without an answer the cycle counts as late; at the time-out
the robot stops and RSI ends. The stop tag ends RSI_MOVECORR, and RSI_OFF comes next, as in all public programs. Then a
person starts the program again, see `RsiProfile.restart_s`.

Source: project specification of RSI, sections 4 to 6.
"""

import math
from collections import Counter
from collections.abc import Sequence

from emulators.arm.followed import FollowedArm
from emulators.arm.told_pose import ToldPose
from emulators.devices.rsi.correction import (
    AXES_TOO_FAR,
    NOTHING,
    TOO_FAR,
    TOO_FAST,
    AxisCorrection,
    Correction,
)
from emulators.devices.rsi.desk import T1_M_S, TO_CONFIRM, Desk, Key
from emulators.devices.rsi.ethernet import Ethernet, Inputs, channels_of
from emulators.devices.rsi.profile import RsiProfile
from emulators.devices.rsi.session import Session, State
from emulators.faults import Handler, Injection
from emulators.faults.own import OwnFaults
from emulators.faults.packets import DATAGRAMS, WIRE, Packets
from emulators.orders import Act, HeardOrder, Hindrance, Orders, Reach
from emulators.seams import ArmPath, ContactSource, Handlers, Joints, StartPose
from emulators.unmodelled import Unmodelled
from protocol.devices.rsi import ROBOT, Telegram, axis_tags, encode, fixed, number, pose_tags
from protocol.devices.rsi.angles import values_of
from protocol.devices.rsi.arm import KukaArm
from protocol.devices.rsi.telegram import LARGEST_IPOC
from protocol.endpoint import RemoteProtocolError
from protocol.geometry import Pose
from protocol.kinematics import Joints as Axes

MAKER = "KUKA"
RUNS, STOPPED = "3", "4"
"""Observed (FZI's configuration): states of the program."""
_EXTERNAL = range(1, 7)
OUT_OF_REACH = "the correction leads out of the reach of the arm's axes"
"""Chosen: words of its own, for those of the controller are not known."""
_PASSED_S = 1e-6
"""Chosen: how long ago the moment of a look at the contact is, so that the path up to it is settled."""
_ACTUAL, _LATE, _STATUS, _OVERRIDE = pose_tags("RIst"), "Delay.D", "ProgStatus.R", "OvPro.R"
_AXES, _TORQUES = axis_tags("AIPos"), axis_tags("GearTorque")
_ANSWERS_A_CYCLE = 64
"""Chosen: answers of a cycle that are looked at. A peer that floods the port is not served."""

_ROUNDING_S = _ROUNDING_M = 1e-9
_EMERGENCY_STOP = "emergency-stop"
_NO_NUMBER = "NaN"
NO_AXES: Axes = (math.nan,) * 6

_BY_ORDER = TOO_FAR, AXES_TOO_FAR, TOO_FAST, OUT_OF_REACH


class RsiController:
    """Endpoint of the controller, and the robot: an `EmulatedRobot`."""

    def __init__(self, profile: RsiProfile, start: StartPose, now: float, seed: int = 0) -> None:
        """Powered up, with the program begun. Raises ValueError for a start that its axes cannot hold."""
        self.profile = profile
        self._arm = FollowedArm(profile.arm, Pose(start.position, start.quaternion), now)
        self._kinematics = KukaArm(profile.model, start.tool_length)
        axes = self._kinematics.holding(self._arm.set_point(now))
        if axes is None:
            raise ValueError(
                f"no axes of the {profile.model} hold the start pose; change start_position_mm or start_quaternion "
                f"(tool at {', '.join(f'{p * 1e3:g}' for p in start.position)} mm)"
            )
        self._aimed: tuple[Pose, Axes] = self._arm.set_point(now), axes
        """Pose that was ordered last, and its axes, degrees."""
        self._standing: tuple[Pose, Axes] = self._aimed
        """Pose that was told last, and its axes."""
        self._contact: ContactSource | None = None
        self._powered_at, self._beats = now, 0
        self._ipoc = profile.ipoc_start - profile.cycle_ms
        self._own = OwnFaults()
        self._told_pose = ToldPose(self._arm.pose)
        self._out: list[bytes] = []
        self._restart_at = math.inf
        self._stopped_by_fault = False
        self.desk = Desk()
        """What a person has done at the panel."""
        self.error = ""
        """The error that has ended RSI; empty without."""
        self.discarded: Counter[str] = Counter()
        """Answers that were not taken, by reason."""
        self._taken = 0
        """Answers that were looked at in this cycle."""
        self.endpoint: Packets[Sequence[bytes]] = Packets(self, DATAGRAMS, f"{seed} rsi")
        self.orders = Orders()
        self.unmodelled = Unmodelled("rsi")
        self._ordered = NOTHING * 2
        """Sum of the relative corrections that were ordered, taken or not."""
        self._channels = channels_of(profile)
        self.path: ArmPath = self._arm.path
        self.handlers: Handlers = self._handlers()
        self.state = State.ON
        self._session = self._begun(now)

    @property
    def accepted(self) -> int:
        return self._arm.path.accepted

    def begun_at(self, target: int) -> float | None:
        return self._arm.path.begun_at(target)

    def joints_holding(self, pose: Pose, at: float) -> Joints | None:
        axes = self._kinematics.holding(pose, self._standing[1])
        return None if axes is None else tuple(map(math.radians, axes))

    def feel(self, contact: ContactSource) -> None:
        """The force at the tool comes from here."""
        self._contact = contact

    def hindrance(self, now: float) -> Hindrance | None:
        if self.error:
            return Hindrance(self.error, self.error in _BY_ORDER and not self._stopped_by_fault)
        if not self._sending:
            return Hindrance("RSI is off", False)
        struck = self._own.holds(_EMERGENCY_STOP, now) or self._own.holds("stands", now)
        words = "the motion is stopped" if struck else self.desk.hindrance or self._session.waits
        return Hindrance(f"{words}, telegrams go on", False) if words else None

    @property
    def correction(self) -> tuple[float, ...]:
        """The total correction: X Y Z in mm, A B C in degrees; then that of the axes, degrees."""
        return self._session.correction.total + self._session.axes.total

    @property
    def ordered_pose(self) -> Pose:
        """The pose that the corrections make, before any lag of the arm."""
        return self._aimed[0]

    def pose(self, now: float) -> Pose:
        """Pose of the tool centre point at a time, s."""
        return self._arm.pose(now)

    @property
    def late(self) -> int:
        """Late cycles since RSI_ON."""
        return self._session.ethernet.late

    # --- as an endpoint

    def receive(self, data: Sequence[bytes], now: float) -> None:
        if self.orders.listener is not None:
            for datagram in data:
                self.orders.tell(self._heard(datagram, now))
        if not self._sending:
            return
        for datagram in data:
            self._taken += 1
            if self._taken > _ANSWERS_A_CYCLE:
                return
            if why := self._session.ethernet.take(datagram, self._ipoc):
                self.discarded[why if len(self.discarded) < _ANSWERS_A_CYCLE else "others"] += 1

    def _heard(self, raw: bytes, now: float) -> HeardOrder:
        """An answer as an order, whatever the state makes of it."""
        try:
            telegram = self._session.ethernet.read(raw)
            *values, _ = self._values_of(telegram)
        except RemoteProtocolError as error:
            return HeardOrder(now, Act.UNREADABLE, str(error), False)
        if telegram.values and self._channels.keys().isdisjoint(telegram.values):
            words = f"tag {next(iter(telegram.values))}, see cell.rsi.correction_tag and axis_tags"
            return HeardOrder(now, Act.REFUSED, words, False)
        if self.profile.mode == "relative":
            values = [before + more for before, more in zip(self._ordered, values, strict=True)]
            self._ordered = tuple(values)
        taken = self.state is State.MOVECORR and self.hindrance(now) is None
        session = self._session
        correction, period = session.correction, self.profile.period
        base, speed, turn = correction.programmed, correction.step_mm * 1e-3, correction.step_rad
        if any(values[6:]):
            a, b, c, d, e, f = (at + by for at, by in zip(session.axes.programmed, values[6:], strict=True))
            base = self._kinematics.pose((a, b, c, d, e, f))
            by_axes = math.radians(sum(session.axes.steps))
            speed, turn = speed + self._kinematics.reach * by_axes, turn + by_axes
        pose = correction.corrected(base, tuple(values[:6]))
        reach = Reach(period, min(speed, self._tool_step_m) / period, turn / period)
        breach = "" if telegram.ipoc == self._ipoc else "the IPOC of another telegram than the newest"
        words = f"{self.profile.mode} correction"
        return HeardOrder(now, Act.MOTION, words, taken, pose, reach=reach, breach=breach)

    def _values_of(self, telegram: Telegram) -> list[float]:
        """Values of the channels in an answer: pose, axes, stop; 0 for one that is missing."""
        values = dict.fromkeys(self._channels.values(), 0.0)
        for tag in reversed(self._channels):
            if tag in telegram.values:
                values[self._channels[tag]] = number(telegram.values[tag])
        return list(values.values())

    def next_event(self) -> None:
        return None

    def data_to_send(self, now: float) -> Sequence[bytes]:
        out, self._out = self._out, []
        return out

    def next_deadline(self) -> float | None:
        return self._next_beat()

    def handle_deadline(self, now: float) -> None:
        """Cycles that a stalled process has missed are skipped: a real controller would not have missed them. The
        newest that is due is told as of its own time.
        """
        due = self._next_beat()
        if now < due:
            return
        missed = math.floor((now - due) / self.profile.period + _ROUNDING_S)
        self._beats += missed
        self._advance_clock(missed)
        at = self._next_beat()
        self._beats += 1
        self._cycle(at)

    # --- cycles

    @property
    def _sending(self) -> bool:
        return self.state in (State.ON, State.MOVECORR)

    def _next_beat(self) -> float:
        return self._powered_at + self._beats * self.profile.period

    def _advance_clock(self, cycles: int) -> None:
        self._ipoc = (self._ipoc + cycles * self.profile.cycle_ms) & LARGEST_IPOC

    def _cycle(self, now: float) -> None:
        """The end of a cycle, and the begin of the next."""
        if now >= self._restart_at and not self.desk.hindrance:
            self._begin(now)
        if self._sending and self._session.sent:
            self._end_cycle(now)
        self._advance_clock(1)
        if self._sending:
            self._send(now)

    def _end_cycle(self, now: float) -> None:
        self._taken = 0
        inputs = self._session.ethernet.close()
        if inputs.error:
            self._fail(inputs.error, now)
            return
        session = self._session
        edge, session.stop_before = inputs.stop and not session.stop_before, inputs.stop
        left = session.left_at < math.inf
        if not left and now - session.begun_at >= self.profile.move_after_ms / 1e3 - _ROUNDING_S:
            self._begin_moving()
        off_after_ms = self.profile.off_after_ms
        if off_after_ms and now - session.left_at >= off_after_ms / 1e3 - _ROUNDING_S:
            self.end_program(now)
            self._restart_later(now)
        if self.state is not State.MOVECORR:
            return
        if edge:
            self.state, session.left_at = State.ON, now
            self._arm.hold(now)
        elif not self._stopped(now):
            self._correct(inputs, now)

    def _begin_moving(self) -> None:
        """RSI_MOVECORR begins, in T1 and T2 once a person has confirmed its message."""
        session, desk = self._session, self.desk
        if self.state is State.ON and desk.is_test and not session.waits:
            session.waits, desk.to_confirm = TO_CONFIRM, True
        if not desk.to_confirm:
            session.waits, self.state = "", State.MOVECORR

    def _correct(self, inputs: Inputs, now: float) -> None:
        """Move by the values of a cycle, unless they are refused."""
        session = self._session
        limit = self._own.under_way("limit", now)
        margin_mm = None if limit is None else limit.number("mm")
        session.correction.narrow(margin_mm)
        reach_mm = self._kinematics.reach * 1e3
        session.axes.narrow(None if margin_mm is None else math.degrees(margin_mm / reach_mm))
        before = self._aimed
        error = session.correction.take(inputs.correction) or session.axes.take(inputs.axes)
        if not error and not self._aim():
            error = OUT_OF_REACH
        elif math.dist(self._aimed[0].position, before[0].position) > self._tool_step_m + _ROUNDING_M:
            self._aimed, error = before, TOO_FAST
        if error:
            self._fail(error, now)
        else:
            session.standing = False
            self._arm.follow(self._aimed[0], now)

    @property
    def _tool_step_m(self) -> float:
        """Farthest that the operating mode lets the tool go in a cycle, m."""
        return T1_M_S * self.profile.period if self.desk.key is Key.T1 else math.inf

    def _aim(self) -> bool:
        """Work out pose and axes of the corrections; False where the arm's axes cannot hold them."""
        session = self._session
        pose = session.correction.pose
        axes: Axes | None
        if session.axes.total != NOTHING:
            axes = session.axes.joints
            if not self._kinematics.allows(axes):
                return False
            pose = self._kinematics.pose(axes)
            if session.correction.total != NOTHING:
                pose = session.correction.applied_to(pose)
        if pose != self._aimed[0]:
            axes = self._kinematics.holding(pose, self._aimed[1])
            if axes is None:
                return False
            self._aimed = pose, axes
        return True

    def _stopped(self, now: float) -> bool:
        """Whether the motion is stopped while telegrams go on."""
        struck = self._own.under_way(_EMERGENCY_STOP, now) or self._own.under_way("stands", now)
        if struck or self.desk.hindrance:
            if not self._session.standing:
                self._arm.hold(now)
            self._session.standing = True
            return True
        return False

    def _runs(self, now: float) -> bool:
        """Whether the program runs, as its status tells it."""
        return not (self.desk.hindrance or self._own.holds(_EMERGENCY_STOP, now))

    def _begin(self, now: float) -> None:
        """The program is reset and begun anew, up to RSI_ON."""
        self.desk.to_confirm = False
        self.state, self.error = State.ON, ""
        self._stopped_by_fault = False
        self._restart_at = math.inf
        self._session = self._begun(now)
        if self.profile.ipoc_restart == "anew":
            self._ipoc = self.profile.ipoc_start - self.profile.cycle_ms

    def _begun(self, now: float) -> Session:
        """A session that corrects from where the robot stands."""
        programmed = self._arm.set_point(now)
        ethernet = Ethernet(self.profile, self.unmodelled)
        self._ordered = NOTHING * 2
        axes = self._axes_of(programmed)
        correction = AxisCorrection(self.profile, axes, self._kinematics.model)
        return Session(
            now, ethernet, Correction(self.profile, programmed), correction, self._lasting(programmed, axes)
        )

    def _axes_of(self, pose: Pose) -> Axes:
        """The axes of a pose, next to those that were told last; those where no axes hold it."""
        if pose != self._standing[0]:
            axes = self._kinematics.holding(pose, self._standing[1])
            self._standing = pose, axes or self._standing[1]
        return self._standing[1]

    def _fail(self, error: str, now: float) -> None:
        """An error ends RSI: the robot stops on its path."""
        self.state, self.error = State.ERROR, error
        self._arm.hold(now)
        self._restart_later(now)

    def _restart_later(self, now: float) -> None:
        self._restart_at = now + self.profile.restart_s if self.profile.restart_s else math.inf

    # --- telegrams

    def _send(self, now: float) -> None:
        empty = self.profile.empty_first and not self._session.sent
        self._session.sent += 1
        values = {} if empty else self._values(now)
        self._out.append(encode(Telegram(ROBOT, MAKER, values, self._ipoc), self.profile.rob_type_attr))

    def _values(self, now: float) -> dict[str, str]:
        """The values of the tags that the configuration sends."""
        values, session = dict(self._session.values), self._session
        if _ACTUAL[0] in values:
            pose = self._told_pose.told(self._arm.pose(now), now)
            if pose is None:
                values = {tag: text for tag, text in values.items() if tag not in (*_ACTUAL, *_AXES)}
            else:
                values.update(zip(_ACTUAL, self._texts(values_of(pose)), strict=True))
                if _AXES[0] in values:
                    axes = NO_AXES if math.isnan(pose.position[0]) else self._axes_of(pose)
                    values.update(zip(_AXES, self._texts(axes), strict=True))
        if any(tag in values for tag in _TORQUES) and self._contact is not None:
            torques = self._texts(self._kinematics.torques(self._aimed[1], self._contact(now - _PASSED_S)))
            values.update({tag: text for tag, text in zip(_TORQUES, torques, strict=True) if tag in values})
        if _LATE in values:
            values[_LATE] = str(session.ethernet.late)
        if _STATUS in values:
            values[_STATUS] = RUNS if self._runs(now) else STOPPED
        if _OVERRIDE in values:
            values[_OVERRIDE] = str(self.desk.override_percent)
        return values

    def _lasting(self, programmed: Pose, axes: Axes) -> dict[str, str]:
        """The same as far as they stay the same in a session, in their order."""
        values: dict[str, str] = {}
        for tag in self.profile.send:
            name = tag.removeprefix("DEF_")
            match name:
                case "RIst" | "RSol":
                    group = dict(zip(pose_tags(name), self._texts(values_of(programmed)), strict=True))
                case "AIPos" | "ASPos":
                    group = dict(zip(axis_tags(name), self._texts(axes), strict=True))
                case "MACur":
                    group = dict.fromkeys(axis_tags(name), self._texts((0.0,))[0])
                case "EIPos" | "ESPos" | "MECur":
                    group = dict.fromkeys((f"{name}.E{axis}" for axis in _EXTERNAL), self._texts((0.0,))[0])
                case "Delay":
                    group = {_LATE: "0"}
                case _:
                    group = {name: "0"}
            values |= group
        return values

    def _texts(self, values: Sequence[float]) -> list[str]:
        return [_NO_NUMBER if math.isnan(v) else fixed(v, self.profile.precision) for v in values]

    # --- faults

    def _handlers(self) -> Handlers:
        own = self._own
        acts = {
            "guidance-ended": self.end_program,
            "program-restarted": self.reset_program,
            "drives-stop": lambda now: self._stop_by(TOO_FAST, now),
            "out-of-limits": lambda now: self._stop_by(TOO_FAR, now),
        }
        return {
            "robot": {
                **own.held((_EMERGENCY_STOP, "stands", "limit")),
                **own.striking(acts),
                "clock-jump": Handler(self._jump),
            },
            "pose": self._told_pose.handlers,
            WIRE: self.endpoint.handlers,
        }

    def end_program(self, now: float) -> None:
        """RSI_OFF: nothing is sent any more, and the arm stands."""
        self.state, self._restart_at = State.CREATED, math.inf
        self._arm.hold(now)

    def reset_program(self, now: float) -> None:
        """Reset the program and begin it anew where the robot stands, up to RSI_ON."""
        self._arm.hold(now)
        self._begin(now)

    def _stop_by(self, error: str, now: float) -> None:
        self._fail(error, now)
        self._stopped_by_fault = True

    def _jump(self, injection: Injection) -> None:
        self._ipoc = max(0, self._ipoc + int(injection.number("ms")))
        injection.struck += 1
        injection.finish(injection.injected_at)
