"""Controller and client on one desk, without wires, in time that the test advances."""

from typing import Any

from hil_fanuc.channels import Channel, Ended, OpenSession, Piece
from hil_fanuc.client import FanucClient
from hil_fanuc.controller import FanucController
from hil_fanuc.packets import (
    JOINTS,
    Command,
    Kind,
    Report,
    Signal,
    ToClient,
    ToRobot,
    decode_to_client,
    encode_to_robot,
    nine,
)
from hil_fanuc.profile import FanucProfile
from hil_fanuc.rmi import LineReader, encode
from hil_fanuc.rmi_server import Connection, Door
from hil_fanuc.settings import FanucSettings

from emulators.faults import Injection
from emulators.orders import ReceivedOrder
from emulators.seams import StartPose
from protocol.datagram import Datagram, side_of
from protocol.geometry import Pose
from protocol.robot import ReportReceived, RobotReport, StreamEvent

T0 = 1000.0
START = StartPose((0.9, -0.1, 0.6), (0.0, 1.0, 0.0, 0.0), 0.2)


class Desk:
    """Emulated controller with a peer that a test writes itself, packet by packet."""

    def __init__(self, profile: FanucProfile | None = None, start: StartPose = START) -> None:
        self.profile = profile or FanucProfile()
        self.now = T0
        self.robot = FanucController(self.profile, start, T0, 7)
        self.version = self.profile.version
        self.packets: list[ToClient] = []
        """Packets for the peer "client"."""
        self.others: list[ToClient] = []
        """Packets for any other peer."""
        self.orders: list[ReceivedOrder] = []
        self.robot.orders.listener = self.orders.append
        self.session = Connection(self.robot.interface, T0)
        self._reader = LineReader()
        self.messages: list[Any] = []

    # --- Stream Motion

    def send(self, packet: ToRobot | bytes, side: str = "client") -> None:
        data = packet if isinstance(packet, bytes) else encode_to_robot(packet)
        self.robot.endpoint.receive([Datagram(data, self.now, side)], self.now)
        self._collect()

    def signal(self, kind: Kind, side: str = "client") -> None:
        self.send(Signal(kind, self.version), side)

    @property
    def report(self) -> Report:
        """Newest report."""
        return next(packet for packet in reversed(self.packets) if isinstance(packet, Report))

    @property
    def reports(self) -> list[Report]:
        return [packet for packet in self.packets if isinstance(packet, Report)]

    def command(
        self, joints: Any, style: int = JOINTS, last: bool = False, sequence: int | None = None
    ) -> None:
        number = self.report.sequence if sequence is None else sequence
        self.send(Command(self.version, number, nine(joints), style, last))

    def tick(self, cycles: int = 1) -> None:
        """Let cycles pass, and everything that is due in them."""
        for _ in range(cycles):
            due = self.robot.endpoint.next_deadline()
            assert due is not None
            line = self.session.next_deadline()
            if line is not None and line <= due:
                self.now = max(self.now, line)
                self.session.handle_deadline(self.now)
            self.now = due
            self.robot.endpoint.handle_deadline(self.now)
            self._collect()

    def wait(self, seconds: float) -> None:
        self.tick(round(seconds / self.profile.cycle_s))

    def _collect(self) -> None:
        for datagram in self.robot.endpoint.data_to_send(self.now):
            side = side_of(datagram)
            (self.packets if side == "client" else self.others).append(decode_to_client(datagram))
        self.messages += self._reader.feed(self.session.data_to_send(self.now))

    # --- Remote Motion Interface

    def ask(self, message: dict[str, Any]) -> dict[str, Any]:
        """Return the answer to a line."""
        count = len(self.messages)
        self.session.receive(encode(message), self.now)
        for _ in range(100):
            self.tick()
            if answers := [one for one in self.messages[count:] if "ErrorID" in one]:
                return dict(answers[0])
        raise AssertionError(f"no answer to {message}")

    def call(self) -> int:
        """Initialize, and call the TP program. Return the ErrorID."""
        assert self.ask({"Command": "FRC_Initialize", "GroupMask": 1})["ErrorID"] == 0
        number = self.ask({"Command": "FRC_GetStatus"})["NextSequenceID"]
        call = {"Instruction": "FRC_Call", "SequenceID": number, "ProgramName": "STREAM_MOTN"}
        return int(self.ask(call)["ErrorID"])

    def begin(self) -> None:
        """Begin a session, and wait until the controller is ready."""
        assert self.call() == 0
        self.signal(Kind.START)
        for _ in range(250):
            self.tick()
            if self.reports and self.report.status & 1:
                return
        raise AssertionError("never ready")

    # --- motion

    def move(self, axis: int, speed: float, seconds: float, acceleration: float = 200.0) -> None:
        """Move one joint: up to a speed, degrees/s, without a jump of the acceleration, and then at that speed."""
        joints, cycle = list(self.robot.motion.set_point), self.profile.cycle_s
        rise, at = 1.5 * speed / acceleration, 0.0
        while at < seconds:
            at += cycle
            share = min(at / rise, 1.0)
            joints[axis] += speed * share * share * (3.0 - 2.0 * share) * cycle
            self.command(joints)
            self.tick()

    def inject(self, target: str, fault: str, for_s: float | None = None, **values: float) -> Injection:
        ends = self.now + for_s if for_s is not None else None
        injection = Injection(target, fault, values, self.now, ends)
        self.robot.handlers[target][fault].begin(injection)
        return injection


class Pair:
    """Client of the bridge with the emulated controller."""

    def __init__(self, profile: FanucProfile | None = None, settings: FanucSettings | None = None) -> None:
        self.desk = Desk(profile)
        self.desk.session.close(T0)
        self.robot = self.desk.robot
        self.now = T0 + 1.0
        self.client = FanucClient(settings or FanucSettings(), self.now)
        self._door = Door(self.robot.interface)
        self._session: Connection | None = None
        self.events: list[StreamEvent] = []
        self.sent: list[Piece | OpenSession] = []
        """Everything that the client has sent."""
        self.goal: Pose | None = None
        """Set point for the next answers; None outside a movement."""

    @property
    def reports(self) -> list[RobotReport]:
        return [event.report for event in self.events if isinstance(event, ReportReceived)]

    def run(self, seconds: float) -> None:
        end = self.now + seconds
        while True:
            self._exchange()
            ends = [self._door, self._session, self.client, self.robot.endpoint]
            deadlines = [at for one in ends if one is not None and (at := one.next_deadline()) is not None]
            due = max(min(deadlines), self.now)
            if due > end:
                self.now = end
                return
            self.now = due
            for one in ends:
                at = None if one is None else one.next_deadline()
                if one is not None and at is not None and at <= self.now:
                    one.handle_deadline(self.now)

    def _exchange(self) -> None:
        while True:
            pieces = [
                Piece(Channel.STREAM, datagram) for datagram in self.robot.endpoint.data_to_send(self.now)
            ]
            for channel, end in ((Channel.DOOR, self._door), (Channel.SESSION, self._session)):
                if end is not None and (data := end.data_to_send(self.now)):
                    pieces.append(Piece(channel, data))
            self.client.receive(pieces, self.now)
            while (event := self.client.next_event()) is not None:
                self.events.append(event)
                if isinstance(event, ReportReceived):
                    if self.goal is None:
                        self.client.hold(self.now)
                    else:
                        self.client.target(self.goal, self.now)
            out = self.client.data_to_send(self.now)
            self.sent += out
            for piece in out:
                self.deliver(piece)
            if not pieces and not out:
                return

    def deliver(self, piece: Piece | OpenSession | Ended) -> None:
        if isinstance(piece, OpenSession):
            self._session = Connection(self.robot.interface, self.now)
        elif isinstance(piece, Ended):
            raise AssertionError("a client does not end connections")
        elif piece.channel is Channel.STREAM:
            self.robot.endpoint.receive([Datagram(piece.data, self.now, "bridge")], self.now)
        elif piece.channel is Channel.DOOR:
            self._door.receive(piece.data, self.now)
        elif self._session is not None:
            self._session.receive(piece.data, self.now)


def alarms(desk: Desk) -> list[str]:
    """Return the numbers of the active alarms."""
    return [text.split(" ")[0] for text in desk.robot.program.alarms.active]


def started(profile: FanucProfile | None = None) -> Desk:
    desk = Desk(profile)
    desk.begin()
    return desk
