"""Emulated controller with Externally Guided Motion: its session, cycle, and datagrams.

One cycle [M]: read the measured position, send a datagram, take the next message from the queue, move the set
point. The controller sends first, on its own clock, and does not wait for answers.

It executes this RAPID program: EGMReset, EGMGetId, EGMSetupUC, EGMActPose, EGMRunPose. After a timeout, the
program's error handler begins another session once `retry_s` has passed. After any other error the program stops
until it is restarted.
"""

import math
from collections import Counter
from collections.abc import Sequence

from emulators.arm.followed import FollowedArm
from emulators.devices.egm.guided import ArmJoints, GuidedMotion, mechanics
from emulators.devices.egm.profile import EgmProfile
from emulators.devices.egm.queue import MessageQueue
from emulators.devices.egm.receiver import Receiver
from emulators.devices.egm.reporter import Reporter
from emulators.devices.egm.state import (
    EMERGENCY_STOP,
    MOTORS_OFF,
    OUT_OF_BOUNDS,
    OVER,
    POWERLESS,
    PROGRAM_STOPPED,
    STOPPED,
    Desk,
    Session,
    State,
    Stops,
)
from emulators.devices.egm.stiffness import JOINT_STIFFNESS, MODE
from emulators.faults.ledger import Handler, Injection
from emulators.faults.own import OwnFaults
from emulators.faults.packets import DATAGRAMS, WIRE, Packets
from emulators.orders import Hindrance, Orders
from emulators.seams import ArmPath, ContactSource, Handlers, Joints, StartPose
from emulators.unmodelled import Unmodelled
from protocol.devices.egm import Answer, SensorMessage
from protocol.geometry import Pose, normalise

_CANNOT_SEND = "event 41830: the message cannot be sent"
_TIME_OUT = "event 41822: ERR_UDPUC_COMM, no message from the PC"


class EgmController:
    """Controller and its arm: an `EmulatedRobot` over datagrams."""

    def __init__(self, profile: EgmProfile, start: StartPose, now: float, seed: int) -> None:
        """Power up at `now`, with the program running. Raises ValueError for a start that the arm cannot hold."""
        pose = Pose(start.position, normalise(start.quaternion))
        self._profile, self._powered_at = profile, now
        self._period = profile.cycle_ms * 1e-3
        self._every = round(profile.sample_ms / profile.cycle_ms)
        self._cycle = 0
        """Number of the next cycle."""
        self.counters: Counter[str] = Counter()
        """Numbers of datagrams sent, accepted and discarded, by name."""
        self.orders, self.unmodelled = Orders(), Unmodelled("egm")
        self.desk, self.stops = Desk(), Stops()
        self.session = Session(profile, self.counters, now)
        kinematics = ArmJoints(profile, start.tool_length)
        self.tool_pose_at = kinematics.pose
        self.motion = GuidedMotion(profile, pose, kinematics)
        """Set point and control law."""
        self.motion.begin(now)
        self._arm = FollowedArm(mechanics(profile), pose, now)
        self.path: ArmPath = self._arm.path
        self.receiver = Receiver(profile, kinematics, self.counters, self.unmodelled, now)
        self.queue = MessageQueue(profile)
        self.targets = self.queue.targets
        self.reporter = Reporter(profile, self.motion, self._arm, now, seed)
        self._out: list[bytes] = []
        self.endpoint: Packets[Sequence[bytes]] = Packets(self, DATAGRAMS, f"{seed} egm")

    # --- as an emulated robot

    @property
    def handlers(self) -> Handlers:
        acts = {
            "guidance-ended": self.end_guidance,
            "out-of-limits": lambda at: self._fail(OUT_OF_BOUNDS, at),
            "cannot-send": lambda at: self._fail(_CANNOT_SEND, at),
            "program-restarted": self.restart_program,
        }
        stop = Handler(self._begin_fault, lambda injection, now: self._end_stop(injection.fault, now))
        stops = dict.fromkeys((EMERGENCY_STOP, MOTORS_OFF, PROGRAM_STOPPED), stop)
        reporter = self.reporter.handlers
        return {
            "robot": {**stops, **OwnFaults().striking(acts)},
            **reporter,
            WIRE: {**self.endpoint.handlers, **reporter[WIRE]},
        }

    def feel(self, contact: ContactSource) -> None:
        self.reporter.feel(contact)

    joint_stiffness, mode = JOINT_STIFFNESS, MODE

    def joints_holding(self, pose: Pose, at: float) -> Joints | None:
        return self.motion.holding(pose)

    def hindrance(self, now: float) -> Hindrance | None:
        return self.session.hindrance(now)

    # --- as an endpoint

    def receive(self, data: Sequence[bytes], now: float) -> None:
        for datagram in data:
            self._receive(datagram, now)

    def next_event(self) -> None:
        return None

    def data_to_send(self, now: float) -> Sequence[bytes]:
        out, self._out = self._out, []
        return out

    def next_deadline(self) -> float | None:
        return self._cycle_at(self._cycle)

    def handle_deadline(self, now: float) -> None:
        while (at := self._cycle_at(self._cycle)) <= now:
            late = self._cycle_at(self._cycle + self._every) <= now
            self._run_cycle(at, silent=late)  # a cycle that this computer has missed is not reported
            self._cycle += 1

    def _cycle_at(self, number: int) -> float:
        return self._powered_at + number * self._period

    def _receive(self, datagram: bytes, now: float) -> None:
        if self.orders.listener is not None:
            self.orders.tell(self.receiver.read_order(datagram, now, self.session.is_guidable))
        if self.session.state in OVER:
            self.counters["not expected"] += 1
            return
        message = self.receiver.accept(datagram, now)
        if message is not None and not self.queue.put(message, now):
            self.counters["queue full"] += 1

    # --- one cycle

    def _run_cycle(self, at: float, silent: bool) -> None:
        session, samples = self.session, self._cycle % self._every == 0
        measured = self._arm.pose(at)
        if samples and session.sends:
            if silent:
                self.counters["cycles missed"] += 1
            else:
                self._out.append(self.reporter.make_datagram(measured, at, session))
                self.counters["datagrams"] += 1
                session.end_sent = session.state in OVER
        if not self.queue and session.state is State.GUIDING and samples:
            self.counters["cycles without a message"] += 1
        message = self.queue.take()
        if message is not None:
            self._act(message, at)
        self._move(at)

    def _act(self, message: Answer, at: float) -> None:
        """Apply a message that has left the queue after its delay."""
        profile = self._profile
        self.motion.take(message)
        moves = self.session.state is State.GUIDING
        self.targets.begin(at + profile.arm.servo_delay_cycles * self._period if moves else math.nan)
        ends = isinstance(message, SensorMessage) and message.digital and profile.rw == "7"
        if ends and profile.di_ends_run:
            self.end_guidance(at)

    def _move(self, at: float) -> None:
        """Advance the motion by one cycle, and end it if a condition or a timeout requires this."""
        motion, profile, session = self.motion, self._profile, self.session
        before, since = motion.pose, at - session.since
        match session.state:
            case State.SET_UP:
                session.state = State.GUIDING
                motion.begin(at)
            case State.GUIDING:
                self._guide(at)
            case State.RAPID_STOPPED if motion.moves:
                if motion.brake(1.0 - since / profile.stop_ramp_s if profile.stop_ramp_s else 0.0):
                    motion.halt()
            case State.ENDED if session.origin is not None:
                share = since / profile.ramp_out_s if profile.ramp_out_s else 1.0
                motion.return_to_start(session.origin, share)
                if share >= 1.0:
                    session.origin = None
            case State.TIMED_OUT if profile.retry_s and since >= profile.retry_s:
                self.restart_program(at)
        if motion.pose != before:
            self._arm.follow(motion.pose, at)

    def _guide(self, at: float) -> None:
        profile = self._profile
        if profile.silence == "error" and at - self.receiver.received_at > profile.comm_timeout_s:
            self._fail(_TIME_OUT, at, State.TIMED_OUT)
        elif error := self.motion.guide(at):
            self._fail(error, at)
        elif self.session.has_converged(self.motion.converged(), at):
            self.end_guidance(at)

    # --- the session

    def restart_program(self, now: float) -> None:
        """Restart the RAPID program from its first line. This begins another session and does not move the tool."""
        self.motion.halt()
        self.motion.begin(now)
        self.session.begin(now)
        self.reporter.begin_session()
        self.receiver.begin_session(now)
        self.queue.clear()
        if self.stops.names:
            self.session.enter(self.stops.state, now)

    def end_guidance(self, now: float) -> None:
        """End EGMRun without an error: the tool is held, or returns to the pose at which the guidance began."""
        if self.session.state is State.GUIDING:
            self.motion.halt()
            self.session.enter(State.ENDED, now)
            self.session.origin = self.motion.pose if self._profile.stop_mode == "ramp_down" else None

    def _fail(self, error: str, at: float, state: State = State.FAILED) -> None:
        """End EGM with an error. RAPID ends as well, unless its error handler continues."""
        self.session.error = error
        self.motion.halt()
        self.session.enter(state, at)

    # --- stops

    def stop(self, name: str, now: float) -> None:
        """Stop the robot for the reason `emergency-stop`, `motors-off` or `program-stopped`. Idempotent."""
        if name not in self.stops.by_hand:
            self.stops.by_hand.add(name)
            self._begin_stop(name, now)

    def start(self, name: str, now: float) -> None:
        """End a stop from the panel. Idempotent."""
        if name in self.stops.by_hand:
            self.stops.by_hand.remove(name)
            self._end_stop(name, now)

    def _begin_fault(self, injection: Injection) -> None:
        injection.struck += 1
        self._begin_stop(injection.fault, injection.injected_at)

    def _begin_stop(self, name: str, now: float) -> None:
        self.stops.names.append(name)
        if name in POWERLESS:
            self.motion.halt()
        if self.session.state not in OVER:
            self.session.enter(self.stops.state, now)

    def _end_stop(self, name: str, now: float) -> None:
        """Resume the motion, unless another stop is active."""
        self.stops.names.remove(name)
        if self.session.state not in STOPPED:
            return
        stays_off = name in POWERLESS and not self._profile.restart_after_motors_off
        if self.stops.names or stays_off:
            self.session.enter(self.stops.state, now)
        else:  # at the current position; messages received during the stop were still accepted [A]
            self.session.resume(now)
            self.receiver.received_at = now
            self.motion.resume(now)
