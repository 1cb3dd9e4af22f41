"""KUKA controller whose program corrects its path by a sensor: RSI_CREATE, RSI_ON, RSI_MOVECORR.

It sends a telegram in each cycle on its own clock and accepts the answers. RSI_MOVECORR keeps a stationary motion
active, so the programmed pose stays the pose at the start of the program. A cycle without an answer counts as late.
At the timeout the robot stops and RSI ends. The stop tag ends RSI_MOVECORR, and RSI_OFF follows, as in all public
programs. An operator then restarts the program; see `RsiProfile.restart_s`.

Source: project specification of RSI, sections 4 to 6.
"""

import math
from collections import Counter
from collections.abc import Sequence

from emulators.devices.rsi.arm import OUT_OF_REACH, CorrectedArm
from emulators.devices.rsi.clock import Clock
from emulators.devices.rsi.correction import AXES_TOO_FAR, TOO_FAR, TOO_FAST, AxisCorrection, Correction
from emulators.devices.rsi.desk import TO_CONFIRM, Desk
from emulators.devices.rsi.ethernet import Ethernet, Inputs
from emulators.devices.rsi.order_reader import OrderReader
from emulators.devices.rsi.profile import RsiProfile
from emulators.devices.rsi.reporter import Reporter
from emulators.devices.rsi.session import Session, State
from emulators.devices.rsi.stiffness import JOINT_STIFFNESS, MODE
from emulators.faults import Handler, Injection
from emulators.faults.own import OwnFaults
from emulators.faults.packets import DATAGRAMS, WIRE, Packets
from emulators.orders import Hindrance, Orders
from emulators.seams import ArmPath, Handlers, Joints, StartPose
from emulators.unmodelled import Unmodelled
from protocol.geometry import Pose

_ANSWERS_A_CYCLE = 64
"""Maximum number of answers read per cycle. Chosen, so that a peer cannot flood the port."""

_ROUNDING_S = 1e-9
_EMERGENCY_STOP = "emergency-stop"

_BY_ORDER = TOO_FAR, AXES_TOO_FAR, TOO_FAST, OUT_OF_REACH


class RsiController:
    """Controller and robot: the controller's end of the wire, and an `EmulatedRobot`."""

    def __init__(self, profile: RsiProfile, start: StartPose, now: float, seed: int = 0) -> None:
        """Power up with the program running. Raises ValueError for a start that the axes cannot hold."""
        self.profile = profile
        self._arm = CorrectedArm(profile, start, now)
        self.path: ArmPath = self._arm.path
        self.targets = self._arm.path.targets
        self.pose, self.feel = self._arm.pose, self._arm.feel
        self.desk = Desk()
        """Actions of the operator at the panel."""
        self._clock = Clock(profile, now)
        self._reporter = Reporter(profile, self._arm, self.desk)
        self._reader = OrderReader(profile, self._arm, self.desk)
        self._faults = OwnFaults()
        self._out: list[bytes] = []
        self.error = ""
        """Error that ended RSI, or an empty string."""
        self.discarded: Counter[str] = Counter()
        """Number of discarded answers by reason."""
        self._answers = 0
        """Number of answers read in this cycle."""
        self.endpoint: Packets[Sequence[bytes]] = Packets(self, DATAGRAMS, f"{seed} rsi")
        self.orders, self.unmodelled = Orders(), Unmodelled("rsi")
        self.state = State.ON
        self._session = self._make_session(now)

    joint_stiffness, mode = JOINT_STIFFNESS, MODE

    def tool_pose_at(self, joints: Joints) -> Pose:
        a, b, c, d, e, f = map(math.degrees, joints)
        return self._arm.kinematics.pose((a, b, c, d, e, f))

    def joints_holding(self, pose: Pose, at: float) -> Joints | None:
        return self._arm.joints_holding(pose)

    def hindrance(self, now: float) -> Hindrance | None:
        if self.error:
            return Hindrance(self.error, self.error in _BY_ORDER and not self._session.ended_by_fault)
        if not self._sending:
            return Hindrance("RSI is off", False)
        struck = self._faults.holds(_EMERGENCY_STOP, now) or self._faults.holds("stands", now)
        text = "the motion is stopped" if struck else self.desk.hindrance or self._session.waits
        return Hindrance(f"{text}, telegrams continue", False) if text else None

    @property
    def correction(self) -> tuple[float, ...]:
        """Total correction: X Y Z in mm, A B C in degrees; then the correction of the axes in degrees."""
        return self._session.correction.total + self._session.axes.total

    @property
    def ordered_pose(self) -> Pose:
        """Corrected pose, before any lag of the arm."""
        return self._arm.ordered_pose

    @property
    def late(self) -> int:
        """Number of late cycles since RSI_ON."""
        return self._session.ethernet.late

    # --- as an endpoint

    def receive(self, data: Sequence[bytes], now: float) -> None:
        if self.orders.listener is not None:
            acts = self.state is State.MOVECORR and self.hindrance(now) is None
            for datagram in data:
                order = self._reader.read(datagram, now, self._session, self._clock.ipoc, acts)
                self.orders.tell(order)
        if not self._sending:
            return
        for datagram in data:
            self._answers += 1
            if self._answers > _ANSWERS_A_CYCLE:
                return
            if why := self._session.ethernet.take(datagram, self._clock.ipoc):
                self.discarded[why if len(self.discarded) < _ANSWERS_A_CYCLE else "others"] += 1

    def next_event(self) -> None:
        return None

    def data_to_send(self, now: float) -> Sequence[bytes]:
        out, self._out = self._out, []
        return out

    def next_deadline(self) -> float | None:
        return self._clock.next_cycle_time

    def handle_deadline(self, now: float) -> None:
        """Run the newest cycle that is due, at its own time.

        Cycles that a stalled process has missed are skipped, because a real controller would not have missed them.
        """
        if now >= self._clock.next_cycle_time:
            self._cycle(self._clock.take_due_cycle(now))

    # --- cycles

    @property
    def _sending(self) -> bool:
        return self.state in (State.ON, State.MOVECORR)

    def _cycle(self, now: float) -> None:
        """End a cycle and begin the next."""
        if now >= self._session.restart_at and not self.desk.hindrance:
            self._begin(now)
        if self._sending and self._session.sent:
            self._end_cycle(now)
        self._clock.advance(1)
        if self._sending:
            runs, ipoc = self._runs(now), self._clock.ipoc
            self._out.append(self._reporter.make_telegram(self._session, ipoc, runs, now))

    def _end_cycle(self, now: float) -> None:
        self._answers = 0
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
        """Start RSI_MOVECORR. In T1 and T2, an operator must confirm its message first."""
        session, desk = self._session, self.desk
        if self.state is State.ON and desk.is_test and not session.waits:
            session.waits, desk.to_confirm = TO_CONFIRM, True
        if not desk.to_confirm:
            session.waits, self.state = "", State.MOVECORR

    def _correct(self, inputs: Inputs, now: float) -> None:
        """Apply the corrections of a cycle, unless they are refused."""
        session = self._session
        limit = self._faults.under_way("limit", now)
        margin_mm = None if limit is None else limit.number("mm")
        session.correction.narrow(margin_mm)
        reach_mm = self._arm.kinematics.reach * 1e3
        session.axes.narrow(None if margin_mm is None else math.degrees(margin_mm / reach_mm))
        error = session.correction.take(inputs.correction) or session.axes.take(inputs.axes)
        if not error:
            step_m = self.desk.tool_step_m(self.profile.period)
            error = self._arm.correct(session.correction, session.axes, step_m, now)
        if error:
            self._fail(error, now)
        else:
            session.is_stopped = False

    def _stopped(self, now: float) -> bool:
        """Return whether the motion is stopped although telegrams continue."""
        struck = self._faults.under_way(_EMERGENCY_STOP, now) or self._faults.under_way("stands", now)
        if struck or self.desk.hindrance:
            if not self._session.is_stopped:
                self._arm.hold(now)
            self._session.is_stopped = True
            return True
        return False

    def _runs(self, now: float) -> bool:
        """Return whether the telegrams report the program as running."""
        return not (self.desk.hindrance or self._faults.holds(_EMERGENCY_STOP, now))

    def _begin(self, now: float) -> None:
        """Reset the program and run it up to RSI_ON."""
        self.desk.to_confirm = False
        self.state, self.error = State.ON, ""
        self._session = self._make_session(now)
        if self.profile.ipoc_restart == "anew":
            self._clock.restart()

    def _make_session(self, now: float) -> Session:
        """Return a session that corrects from the robot's current pose."""
        programmed = self._arm.set_point(now)
        axes = self._arm.axes_of(programmed)
        self._reader.begin_session()
        return Session(
            now,
            Ethernet(self.profile, self.unmodelled),
            Correction(self.profile, programmed),
            AxisCorrection(self.profile, axes, self._arm.kinematics.model),
            self._reporter.constant_values(programmed, axes),
        )

    def _fail(self, error: str, now: float) -> None:
        """End RSI with an error: the robot stops on its path."""
        self.state, self.error = State.ERROR, error
        self._arm.hold(now)
        self._restart_later(now)

    def _restart_later(self, now: float) -> None:
        self._session.restart_at = now + self.profile.restart_s if self.profile.restart_s else math.inf

    # --- faults

    @property
    def handlers(self) -> Handlers:
        own = self._faults
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
            "pose": self._reporter.pose.handlers,
            WIRE: self.endpoint.handlers,
        }

    def end_program(self, now: float) -> None:
        """Execute RSI_OFF: the controller sends nothing more, and the arm stops."""
        self.state, self._session.restart_at = State.CREATED, math.inf
        self._arm.hold(now)

    def reset_program(self, now: float) -> None:
        """Reset the program and restart it at the robot's current pose, up to RSI_ON."""
        self._arm.hold(now)
        self._begin(now)

    def _stop_by(self, error: str, now: float) -> None:
        self._fail(error, now)
        self._session.ended_by_fault = True

    def _jump(self, injection: Injection) -> None:
        self._clock.jump(int(injection.number("ms")))
        injection.struck += 1
        injection.finish(injection.injected_at)
