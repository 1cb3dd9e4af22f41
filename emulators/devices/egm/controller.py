"""An emulated controller with Externally Guided Motion: its session, its cycle, and its datagrams.

One cycle [M]: read the measured place, send a datagram, take the next message of the queue, move the set point. The
controller speaks first and keeps its own time; no answer is waited for.

The RAPID program that is played: EGMReset, EGMGetId, EGMSetupUC, EGMActPose, EGMRunPose. After a time-out its error
handler begins another session, after `retry_s`. After another error it stands until it is started anew.
"""

import math
from collections import Counter, deque
from collections.abc import Sequence

from emulators.arm.followed import FollowedArm
from emulators.arm.own_force import Errors, OwnForce
from emulators.arm.told_pose import ToldPose
from emulators.devices.egm.guided import OUT_OF_BOUNDS, ArmJoints, GuidedMotion, mechanics
from emulators.devices.egm.hearing import Hearing
from emulators.devices.egm.profile import EgmProfile
from emulators.devices.egm.state import (
    EMERGENCY_STOP,
    MOTORS_OFF,
    OVER,
    POWERLESS,
    PROGRAM_STOPPED,
    STOPPED,
    Desk,
    State,
)
from emulators.faults.ledger import Handler, Injection
from emulators.faults.own import OwnFaults
from emulators.faults.packets import DATAGRAMS, WIRE, Packets
from emulators.orders import Hindrance, Orders
from emulators.seams import ArmPath, Handlers, Joints, StartPose
from emulators.unmodelled import Unmodelled
from protocol.devices.egm import (
    Answer,
    Place,
    RobotMessage,
    RobotWare,
    SensorMessage,
    decode_answer,
    encode_robot,
    names_external_axes,
    to_wire,
)
from protocol.endpoint import RemoteProtocolError
from protocol.geometry import Pose, inverse, normalise, rotate

_EPOCH_S = 1_700_000_000
"""Chosen: the controller's calendar at power-up, s since 1970, so that a run of one seed repeats itself."""
_BEGINS = 256
"""Chosen: begins of motion that are kept."""
_NUMBER, _NO_OWN_FORCE = "wrong-seqno", "missing"
_CANNOT_SEND = "event 41830: the message cannot be sent"
_NO_FORCE = (0.0,) * 6


class EgmController:
    """The controller and its arm: an `EmulatedRobot` over datagrams."""

    def __init__(self, profile: EgmProfile, start: StartPose, now: float, seed: int) -> None:
        """Powered up at `now`, with its program running. Raises ValueError for a start that the arm cannot hold."""
        pose = Pose(start.position, normalise(start.quaternion))
        self._profile, self._powered_at = profile, now
        self._period = profile.cycle_ms * 1e-3
        self._every = round(profile.sample_ms / profile.cycle_ms)
        self._kinematics = ArmJoints(profile, start.tool_length)
        self._hearing = Hearing(profile, self._kinematics)
        self.motion = GuidedMotion(profile, pose, self._kinematics)
        """Set point and law."""
        self._arm = FollowedArm(mechanics(profile), pose, now)
        self._measured: tuple[Pose, Joints] = pose, self.motion.joints
        """The pose that was measured last, and the joints that hold it."""
        self.path: ArmPath = self._arm.path
        self.endpoint: Packets[Sequence[bytes]] = Packets(self, DATAGRAMS, f"{seed} egm")
        self.orders, self.unmodelled = Orders(), Unmodelled("egm")
        self.state, self.desk = State.SET_UP, Desk()
        self.error = ""
        """Words of the last error, with the number of its event where that is known."""
        self.counters: Counter[str] = Counter()
        """Datagrams sent and taken, and those that were not used, by name."""
        self.unusable = ""
        """Why the newest message that could not be used could not."""
        self._told_pose = ToldPose(self._arm.pose)
        self._own = own = OwnFaults()
        rms = profile.force_noise_n
        noise = (rms, rms, rms, 0.0, 0.0, 0.0)
        errors = Errors(profile.force_offset_n, profile.force_lag_ms * 1e-3, noise, noise)
        self._own_force = OwnForce(errors, seed)
        self.feel = self._own_force.feel
        """Source of what it feels, see `emulators.seams.FeelingRobot`."""
        self._cycle = 0
        """Number of the next cycle."""
        self._out: list[bytes] = []
        self._begins: deque[float] = deque(maxlen=_BEGINS)
        self._taken = self._begun = 0
        self._newest: int | None = None
        """Number of the newest message; None before the first of a session."""
        self._queue: deque[Answer] = deque()
        self._delayed: deque[Answer | None] = deque()
        """Message that each of the last cycles took from the queue, None for none."""
        self._heard_at = self._held_since = self._since = now
        """When a message came, when the window of convergence was entered, when the state was."""
        self._seqno = 0
        self._converged = self._told_over = False
        self._origin: Pose | None = None
        """Where a way back began; None where there is none."""
        self._stops: list[str] = []
        """Names of the stops that hold now, by faults and by hand."""
        self._by_hand: set[str] = set()
        """Those of a person at the panel."""
        self._begin_session(now)
        self.handlers: Handlers = {
            "robot": {
                **dict.fromkeys(
                    (EMERGENCY_STOP, MOTORS_OFF, PROGRAM_STOPPED), Handler(self._stop, self._start)
                ),
                **own.striking(
                    {
                        "guidance-ended": self._end_run,
                        "out-of-limits": lambda at: self._fail(OUT_OF_BOUNDS, at),
                        "cannot-send": lambda at: self._fail(_CANNOT_SEND, at),
                        "program-restarted": self.restart_program,
                    }
                ),
            },
            "pose": self._told_pose.handlers,
            WIRE: {**self.endpoint.handlers, **own.held((_NUMBER,))},
            "witness": {**self._own_force.handlers, **own.held((_NO_OWN_FORCE,))},
        }

    # --- as an emulated robot

    @property
    def accepted(self) -> int:
        return self._taken

    def begun_at(self, target: int) -> float | None:
        if target > self._begun:
            return None
        kept = self._begun - len(self._begins)
        return self._begins[target - kept - 1] if target > kept else math.nan

    def joints_holding(self, pose: Pose, at: float) -> Joints | None:
        return self._kinematics.holding(pose, self.motion.joints)

    def hindrance(self, now: float) -> Hindrance | None:
        if self.state in (State.SET_UP, State.GUIDING):
            return None
        words = self.state.name.lower().replace("_", " ")
        return Hindrance(f"{words}: {self.error}" if self.error else words, self.error == OUT_OF_BOUNDS)

    @property
    def measured(self) -> tuple[Pose, Joints]:
        """The pose that was measured last, and the joints that hold it."""
        return self._measured

    @property
    def stops(self) -> Sequence[str]:
        """Names of the stops that hold now."""
        return self._stops

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
            self._run_cycle(at, silent=late)  # a cycle that this computer has missed is not told any more
            self._cycle += 1

    def _cycle_at(self, number: int) -> float:
        return self._powered_at + number * self._period

    # --- messages from the PC

    def _receive(self, datagram: bytes, now: float) -> None:
        if self.orders.listener is not None:
            self.orders.tell(self._hearing.hear(datagram, now, self.state in (State.SET_UP, State.GUIDING)))
        if self.state in OVER:
            self.counters["not expected"] += 1
            return
        try:
            message = decode_answer(datagram)
            self._hearing.check(message)
        except RemoteProtocolError as error:
            self.counters["unusable"] += 1
            self.unusable = str(error)
            if self._profile.bad_refreshes_timeout:
                self._heard_at = now
            return
        if self._profile.seqno_check == "drop_old" and self._is_old(message.seqno):
            self.counters["old number"] += 1
            return
        self._newest, self._heard_at = message.seqno, now
        self.counters["messages"] += 1
        if isinstance(message, SensorMessage):
            if names_external_axes(datagram):
                self.unmodelled.touch("externalJoints", "this arm has no external axes")
            if message.dnum:
                self.unmodelled.touch("RAPIDtoRobot.dnum", "no RAPID program reads it")
            if not message.says_something:
                return
        if self._profile.rx_queue == "latest":
            self._drop(len(self._queue))
            self._queue.clear()
        elif len(self._queue) >= self._profile.rx_queue_len:
            self.counters["queue full"] += 1
            return
        self._queue.append(message)
        self._taken += 1

    def _is_old(self, seqno: int) -> bool:
        """Whether a message came before the newest one; number 0 begins anew [A]."""
        return bool(seqno) and self._newest is not None and (self._newest - seqno) % 2**32 < 2**31

    def _drop(self, count: int) -> None:
        """So many messages are given up before they act."""
        for _ in range(count):
            self._begun += 1
            self._begins.append(math.nan)

    # --- one cycle

    def _run_cycle(self, at: float, silent: bool) -> None:
        measured = self._arm.pose(at)
        if self._cycle % self._every == 0 and self._sends():
            if silent:
                self.counters["cycles missed"] += 1
            else:
                self._send(measured, at)
                self._told_over = self.state in OVER
        taken = self._queue.popleft() if self._queue else None
        if taken is None and self.state is State.GUIDING and self._cycle % self._every == 0:
            self.counters["cycles without a message"] += 1
        self._delayed.append(taken)
        acting = self._delayed.popleft() if len(self._delayed) > self._profile.ref_delay_cycles else None
        if acting is not None:
            self._act(acting, at)
        self._move(at)

    def _act(self, message: Answer, at: float) -> None:
        """A message has come through to the motion."""
        self.motion.take(message)
        self._begun += 1
        moves = self.state is State.GUIDING
        self._begins.append(at + self._profile.arm.servo_delay_cycles * self._period if moves else math.nan)
        profile = self._profile
        if (
            isinstance(message, SensorMessage)
            and message.digital
            and profile.rw == "7"
            and profile.di_ends_run
        ):
            self._end_run(at)

    def _move(self, at: float) -> None:
        """Let time pass for the state: one cycle of motion, and the ends that come by themselves."""
        motion, profile = self.motion, self._profile
        before = motion.pose
        if self.state is State.SET_UP:
            self.state = State.GUIDING
            motion.begin(at)
        elif self.state is State.GUIDING:
            if profile.silence == "error" and at - self._heard_at > profile.comm_timeout_s:
                self._time_out(at)
            elif error := motion.guide(at):
                self._fail(error, at)
            else:
                self._watch_convergence(at)
        elif self.state is State.RAPID_STOPPED and motion.moves:
            ramp = profile.stop_ramp_s
            if motion.brake(1.0 - (at - self._since) / ramp if ramp else 0.0):
                motion.stand()
        elif self.state is State.ENDED and self._origin is not None:
            share = (at - self._since) / profile.ramp_out_s if profile.ramp_out_s else 1.0
            motion.go_back(self._origin, share)
            if share >= 1.0:
                self._origin = None
        elif self.state is State.TIMED_OUT and profile.retry_s and at - self._since >= profile.retry_s:
            self._begin_session(at)
        if motion.pose != before:
            self._arm.follow(motion.pose, at)

    def _watch_convergence(self, at: float) -> None:
        self._converged = self.motion.converged()
        if not self._converged:
            self._held_since = at
        elif at - self._held_since >= self._profile.cond_time_s:
            self._end_run(at)

    # --- the session

    def _begin_session(self, at: float) -> None:
        """EGMReset, EGMSetupUC and what follows: the tool stands where it is."""
        self.motion.stand()
        self.motion.begin(at)
        self.state, self.error = State.SET_UP, ""
        self._seqno, self._newest = 0, None
        self._queue.clear()
        self._delayed.clear()
        self._drop(self._taken - self._begun)
        self._heard_at = self._held_since = self._since = at
        self._converged = self._told_over = False
        self._origin = None
        self.counters["sessions"] += 1
        if self._stops:
            self._leave(self._stopped_state(), at)

    def _end_run(self, at: float) -> None:
        """EGMRun ends without an error: the tool is held, or goes back to where the guidance began."""
        if self.state is State.GUIDING:
            self.motion.stand()
            self._leave(State.ENDED, at)
            self._origin = self.motion.pose if self._profile.stop_mode == "ramp_down" else None

    def _time_out(self, at: float) -> None:
        self.error = "event 41822: ERR_UDPUC_COMM, no message from the PC"
        self.motion.stand()
        self._leave(State.TIMED_OUT, at)

    def _fail(self, error: str, at: float) -> None:
        """EGM ends with an error, and RAPID with it."""
        self.error = error
        self.motion.stand()
        self._leave(State.FAILED, at)

    def _leave(self, state: State, at: float) -> None:
        self.state, self._since, self._told_over = state, at, False
        self.counters[f"ended: {state.name}"] += 1

    def _sends(self) -> bool:
        profile = self._profile
        if self.state in STOPPED:
            return profile.sends_stopped
        if self.state in OVER:
            return profile.send_when == "setup" or (profile.last_datagram and not self._told_over)
        return True

    # --- datagrams

    def _send(self, measured: Pose, at: float) -> None:
        motion, profile = self.motion, self._profile
        if measured != self._measured[0]:
            joints = self._kinematics.holding(measured, motion.joints)
            self._measured = measured, joints or motion.joints
        motors, guidance, rapid = self.state.value[:3]
        microseconds = round((at - self._powered_at) * 1e6)
        time_us = _EPOCH_S * 1_000_000 + microseconds
        told = self._told_pose.told(measured, at)
        feedback = Place(
            self._told_joints(self._measured[1]), None if told is None else to_wire(told), (), time_us
        )
        newer = profile.rw == "7"
        message = RobotMessage(
            self._seqno,
            profile.tm_start + microseconds // 1000,
            feedback,
            Place(self._told_joints(motion.joints), to_wire(motion.pose), (), time_us),
            motors,
            guidance,
            rapid,
            self._converged,
            self._force(measured, at) if profile.measured_force else _NO_FORCE,
            False if newer else None,
            motion.utilization_percent,
            0 if newer else None,
            False if newer else None,
            False if newer else None,
        )
        self._seqno += 1
        self.counters["datagrams"] += 1
        self._out.append(encode_robot(self._altered(message, at), RobotWare(profile.rw)))

    def _told_joints(self, joints: Joints) -> tuple[float, ...]:
        return tuple(joints) if self._profile.joints_in == "radians" else tuple(map(math.degrees, joints))

    def _altered(self, message: RobotMessage, at: float) -> RobotMessage:
        """A message as faults let it be told."""
        if (wrong := self._own.under_way(_NUMBER, at)) is not None:
            message = message._replace(seqno=message.seqno + int(wrong.number("by")))
        if self._own.under_way(_NO_OWN_FORCE, at) is not None:
            message = message._replace(force=(), force_control=None)
        return message

    def _force(self, measured: Pose, at: float) -> tuple[float, ...]:
        """The measured force along the tool's axes, N; it tells no moments."""
        return *rotate(inverse(measured.quaternion), self._own_force.at(at)[:3]), 0.0, 0.0, 0.0

    # --- faults

    def _stop(self, injection: Injection) -> None:
        injection.struck += 1
        self._begin_stop(injection.fault, injection.injected_at)

    def _start(self, injection: Injection, now: float) -> None:
        self._end_stop(injection.fault, now)

    # --- by a person at the panel

    def stop(self, name: str, now: float) -> None:
        """Stop the robot: `emergency-stop`, `motors-off` or `program-stopped`. Harmless when called again."""
        if name not in self._by_hand:
            self._by_hand.add(name)
            self._begin_stop(name, now)

    def start(self, name: str, now: float) -> None:
        """End a stop of the panel. Harmless where there is none."""
        if name in self._by_hand:
            self._by_hand.remove(name)
            self._end_stop(name, now)

    def end_guidance(self, now: float) -> None:
        """EGMStop in the RAPID program."""
        self._end_run(now)

    def restart_program(self, now: float) -> None:
        """Start the RAPID program from its first line: another session."""
        self._begin_session(now)

    # --- stops

    def _begin_stop(self, name: str, now: float) -> None:
        self._stops.append(name)
        if name in POWERLESS:
            self.motion.stand()
        if self.state not in OVER:
            self._leave(self._stopped_state(), now)

    def _end_stop(self, name: str, now: float) -> None:
        """The robot goes on, as far as nothing else stops it."""
        self._stops.remove(name)
        if self.state not in STOPPED:
            return
        stays = name in POWERLESS and not self._profile.restart_after_motors_off
        if self._stops or stays:
            self._leave(self._stopped_state(), now)
        else:
            self._go_on(now)

    def _stopped_state(self) -> State:
        return State.MOTORS_OFF if set(POWERLESS) & set(self._stops) else State.RAPID_STOPPED

    def _go_on(self, now: float) -> None:
        """The guidance goes on where the tool stands. Messages that came meanwhile have gone on being taken [A]."""
        self.state = State.GUIDING
        self._heard_at = self._held_since = now
        self.motion.resume(now)
