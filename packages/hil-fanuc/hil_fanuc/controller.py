"""Emulated FANUC controller with Stream Motion and the Remote Motion Interface, and its arm.

In each cycle it takes a set point from its buffer, moves the arm, and sends a report. It sends reports from the start
packet until a stop packet from any peer, also while its TP program does not run.
"""

import math
from collections.abc import Hashable, Sequence

from emulators.faults.ledger import Handler, Injection
from emulators.faults.own import OwnFaults
from emulators.faults.packets import DATAGRAMS, WIRE, Packets
from emulators.orders import Act, Hindrance, Orders, ReceivedOrder
from emulators.seams import ArmPath, ContactSource, Handlers, StartPose
from emulators.seams import Joints as Radians
from hil_fanuc import alarms
from hil_fanuc.alarms import BY_ORDER, Alarms
from hil_fanuc.arms import Joints, from_pendant
from hil_fanuc.motion import Motion
from hil_fanuc.order_reader import OrderReader
from hil_fanuc.packets import (
    CARTESIAN,
    Command,
    ContactStop,
    Kind,
    Signal,
    decode_to_robot,
    encode_to_client,
    header_of,
    is_known,
    nine,
)
from hil_fanuc.profile import FanucProfile
from hil_fanuc.program import Program
from hil_fanuc.reporter import Reporter
from hil_fanuc.rmi_interface import Interface
from hil_fanuc.rmi_motions import RmiMotions
from hil_fanuc.set_points import SetPoints
from hil_fanuc.stiffness import JOINT_STIFFNESS, MODES
from hil_fanuc.stream_server import StreamServer
from protocol.arm_size import PerAxis
from protocol.datagram import Datagram, side_of
from protocol.endpoint import RemoteProtocolError
from protocol.geometry import Pose, Vector

_STRANGER = "stranger"
_PASSED_S = 1e-6
"""Age at which the contact force is read, s. Chosen: the path up to that time is committed."""
SERVO_ALARM = "SRVO-023 Stop error excess"


class FanucController:
    """Controller and robot: the controller's end of Stream Motion, and an `EmulatedRobot`."""

    def __init__(self, profile: FanucProfile, start: StartPose, now: float, seed: int = 0) -> None:
        """Power up at `now`. Raises ValueError for a start that the arm cannot hold."""
        self.profile = profile
        self.orders = Orders()
        self.program = Program(profile, Alarms(self._on_alarm))
        self.server = StreamServer(profile, self.program, self._end_session)
        self.set_points = SetPoints(profile, self.program, self.server)
        self.motion = Motion(profile, start, now, self._decide)
        self.rmi_motions = RmiMotions(profile, lambda: self.set_points.limits)
        self.set_points.motion = self.rmi_motions.motion = self.motion
        self.path: ArmPath = self.motion.path
        self.targets = self.motion.path.targets
        self.reporter = Reporter(profile, self.motion, self.program, self.server, seed)
        self.reporter.begin(now)
        self.server.command_position = self.reporter.set_point
        self._reader = OrderReader(profile, self.motion, self.server)
        self.interface = Interface(self)
        self.unmodelled = self.server.unmodelled
        self._faults = OwnFaults()
        self._contact: ContactSource | None = None
        self._powered_at, self._cycle = now, 1
        self._moving_since = now
        """Time at which the arm was still for the last time, s."""
        self._out: list[bytes] = []
        self.endpoint: Packets[Sequence[bytes]] = Packets(self, DATAGRAMS, f"{seed} fanuc")

    # --- as an emulated robot

    @property
    def handlers(self) -> Handlers:
        acts = {
            "servo-alarm": lambda at: self.program.alarms.raise_(SERVO_ALARM, at),
            "program-aborted": lambda at: self.abort(),
            "tasks-aborted": self.abort_tasks,
            "contact-stop": self._trip,
            "starves": self._starve,
            "stranger-stop": lambda at: self._receive(Signal(Kind.STOP, self.server.version), _STRANGER, at),
            "stranger-start": lambda at: self._receive(
                Signal(Kind.START, self.server.version), _STRANGER, at
            ),
        }
        stop = Handler(self._begin_stop, lambda injection, now: self._end_stop(injection.fault))
        return {
            "robot": {
                "emergency-stop": stop,
                "pendant-on": stop,
                **self._faults.striking(acts),
                **self._faults.held(("stands", "rmi-silent")),
                "clock-jump": Handler(self._jump),
                "lags": Handler(self._begin_lag, lambda injection, now: self.motion.loops.delay(0.0)),
            },
            "pose": self.reporter.pose.handlers,
            WIRE: {**self.endpoint.handlers, **self._faults.held(("wrong-number",))},
            "witness": {**self.reporter.force.handlers, **self.reporter.faults.held(("missing",))},
        }

    @property
    def joint_stiffness(self) -> PerAxis:
        return JOINT_STIFFNESS[self.profile.model]

    @property
    def mode(self) -> tuple[float, float]:
        return MODES[self.profile.model]

    def tool_pose_at(self, joints: PerAxis) -> Pose:
        a, b, c, d, e, f = map(math.degrees, joints)
        return self.motion.arm.pose((a, b, c, d, e, f))

    def joints_holding(self, pose: Pose, at: float) -> Radians | None:
        joints = self.motion.arm.nearest(pose, self.motion.joints)
        return None if joints is None else tuple(map(math.radians, joints))

    def feel(self, contact: ContactSource) -> None:
        self._contact = contact
        self.reporter.force.feel(contact)

    def carry(self, mass: float, centre: Vector) -> None:
        self.set_points.load = mass / self.motion.arm.model.payload_kg

    def hindrance(self, now: float) -> Hindrance | None:
        if self._faults.holds("stands", now):
            return Hindrance("the arm is stopped", False)
        text = self.program.hindrance(now)
        is_ended = self.program.ended_by_client and not self.program.alarms
        if not text or is_ended:
            return None
        by_order = any(text.startswith(alarm) for alarm in BY_ORDER)
        return Hindrance(text, by_order)

    # --- as an endpoint of datagrams

    def receive(self, data: Sequence[bytes], now: float) -> None:
        for datagram in data:
            try:
                packet = decode_to_robot(datagram)
                self._check_known(datagram)
                if self.profile.stream_j3 == "horizon" and isinstance(packet, Command):
                    packet = in_stream(packet)
            except RemoteProtocolError as error:
                self.server.counts["packets that cannot be read"] += 1
                self.report_order(ReceivedOrder(now, Act.UNREADABLE, str(error), False))
                continue
            self._receive(packet, side_of(datagram), now)

    def next_event(self) -> None:
        return None

    def data_to_send(self, now: float) -> Sequence[bytes]:
        out, self._out = self._out + self.server.take_out(), []
        return out

    def next_deadline(self) -> float | None:
        return self._at(self._cycle)

    def handle_deadline(self, now: float) -> None:
        while (at := self._at(self._cycle)) <= now + 1e-9:
            self.motion.path.advance(at)
            self._cycle += 1
            if self._at(self._cycle) > now + 1e-9:  # a cycle that this computer has missed is not reported
                self._report(at)

    def _at(self, number: int) -> float:
        return self._powered_at + number * self.profile.cycle_s

    def _receive(self, packet: object, side: Hashable, now: float) -> None:
        if self.orders.listener is not None:
            acts = not self.program.hindrance(now) and not self._faults.holds("stands", now)
            acts = acts and side == self.server.peer
            order = self._reader.read(packet, now, acts)  # type: ignore[arg-type]
            if order is not None:
                self.report_order(order)
        before = len(self.server.buffer)
        self.server.handle(packet, side, now)  # type: ignore[arg-type]
        if len(self.server.buffer) > before:
            self.targets.accept(now)

    def _check_known(self, datagram: bytes) -> None:
        """Raise RemoteProtocolError for a packet of another version. A start packet is answered with an alarm."""
        kind, version = header_of(datagram).kind, self.profile.version
        if kind != Kind.START and not is_known(kind, version):
            raise RemoteProtocolError(f"a packet of type {kind} to a controller of version {version}")

    # --- cycles

    def _decide(self, at: float) -> Joints:
        """Return the set points for a cycle."""
        if self._faults.under_way("stands", at):
            self.motion.lock()
            self.server.buffer.clear()
            return self.motion.set_point
        if self.rmi_motions.is_busy:
            joints = self.rmi_motions.decide(at)
            self.interface.push_done(self.rmi_motions.done)
            return joints
        before = len(self.server.buffer)
        joints = self.set_points.decide(at)
        self.set_points.expects = False
        if before > len(self.server.buffer):
            self.targets.begin_newest(at + self.motion.loops.delay_s)
        return joints

    def _report(self, at: float) -> None:
        self._watch_contact(at)
        self._watch_motion(at)
        server = self.server
        if not server.is_open or self.program.hangs:
            return
        server.sequence += 1
        report = self.reporter.report(at)
        if wrong := self._faults.under_way("wrong-number", at):
            report = report._replace(sequence=report.sequence + int(wrong.number("by")))
        self._out.append(Datagram(encode_to_client(report), side=server.peer))
        self.set_points.expects = True

    def _watch_motion(self, at: float) -> None:
        """Check that the arm comes to rest in time."""
        limit = self.profile.status_check_s
        if self.motion.fastest_deg_s <= self.profile.in_motion_deg_s:
            self._moving_since = at
        elif limit and at - self._moving_since > limit:
            self.program.alarms.raise_(alarms.STATUS_CHECK, at)

    def _watch_contact(self, at: float) -> None:
        if self.set_points.is_jerky:
            self.set_points.is_jerky = False
            self._trip(at)
        limit = self.profile.contact_stop_n
        if limit and self._contact is not None and math.hypot(*self._contact(at - _PASSED_S)) > limit:
            self._trip(at)

    # --- sessions and stops

    def report_order(self, order: ReceivedOrder) -> None:
        """Report an order to the judge."""
        self.orders.tell(order)

    def is_silent(self, now: float) -> bool:
        """Return whether a fault keeps the Remote Motion Interface from answering."""
        return self._faults.under_way("rmi-silent", now) is not None

    def reset(self, now: float) -> bool:
        """Clear alarms whose cause is gone; return whether none is left."""
        if self.program.stopped_at is not None:
            return False
        self.program.alarms.reset()
        self.reporter.contact_stop = ContactStop.NONE
        return True

    def abort(self) -> None:
        """Abort the TP programs."""
        self.rmi_motions.clear()
        self.program.abort()

    def abort_tasks(self, now: float) -> None:
        """Abort all tasks at the teach pendant: the server hangs until the power is cycled (observed)."""
        self.abort()
        self.program.hangs = True
        self.interface.push_fault()

    def cycle_power(self, now: float) -> None:
        """Switch the controller off and on. Clients have to begin again."""
        self.server.end(now)
        self.program.alarms.reset()
        self.reporter.contact_stop = ContactStop.NONE
        self.program.power_up()

    def _end_session(self, now: float) -> None:
        self.set_points.begin()

    def _on_alarm(self, text: str, now: float) -> None:
        self.rmi_motions.clear()
        if not self.program.alarms:
            self.program.hold_by_alarm(now)
            self.interface.push_fault()

    def _trip(self, now: float) -> None:
        self.reporter.contact_stop = ContactStop.STOP
        self.program.alarms.raise_(alarms.CONTACT, now)

    def _starve(self, now: float) -> None:
        self.program.starved = True

    def _begin_stop(self, injection: Injection) -> None:
        injection.strike(injection.injected_at)
        if injection.fault == "pendant-on":
            self.program.pendant_on = True
            self.abort()
        else:
            self.program.press_stop(injection.injected_at)

    def _begin_lag(self, injection: Injection) -> None:
        injection.strike(injection.injected_at)
        self.motion.loops.delay(injection.number("ms") / 1e3)

    def _end_stop(self, name: str) -> None:
        if name == "pendant-on":
            self.program.pendant_on = False
        else:
            self.program.release_stop()

    def _jump(self, injection: Injection) -> None:
        self.reporter.shift_clock(injection.number("ms") / 1e3)
        injection.strike(injection.injected_at)
        injection.finish(injection.injected_at)


def in_stream(command: Command) -> Command:
    """Convert a command whose J3 is measured against the horizon."""
    if command.data_style == CARTESIAN:
        return command
    a, b, c, d, e, f = command.position[:6]
    return command._replace(position=nine(from_pendant((a, b, c, d, e, f))))
