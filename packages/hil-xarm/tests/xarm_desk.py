"""Control box and client on one desk, without wires, in time that the test advances."""

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from hil_xarm.client import XarmClient
from hil_xarm.dialogue import Piece
from hil_xarm.force import ForceSensor
from hil_xarm.force_client import ForceClient
from hil_xarm.frames import FrameReader, Function, Mode, Reply, Request, pack_floats
from hil_xarm.profile import XarmProfile
from hil_xarm.reports import LAYOUTS, Port, ReportReader
from hil_xarm.robot import XarmRobot

from emulators.faults import Ledger
from emulators.orders import ReceivedOrder
from emulators.seams import Floats, StartPose
from emulators.sensing import KnownWrench
from protocol.geometry import Wrench

T0 = 1000.0
START = StartPose((0.4, -0.1, 0.2), (0.0, 1.0, 0.0, 0.0), 0.2)
FAULTY = {"probability": 1.0, "ms": 190.0}


class Desk:
    """Emulated box with a peer that a test writes itself, command by command."""

    def __init__(
        self, profile: XarmProfile | None = None, start: StartPose = START, sensor: bool = True
    ) -> None:
        self.now = T0
        self.load: Wrench = (0.0,) * 6
        self.profile = profile or XarmProfile(
            noise_n=0.0, noise_nm=0.0, wander_n=0.0, vibration_n=0.0, motion_n=0.0
        )
        self.robot = XarmRobot(self.profile, start, T0, 7)
        self.box = self.robot.box
        self.sensor = ForceSensor(self.profile, KnownWrench(self._wrench), T0, 7)
        if sensor:
            self.robot.equip(self.sensor)
        self.orders: list[ReceivedOrder] = []
        self.robot.orders.listener = self.orders.append
        self.ledger = Ledger({})
        self.ends = {port: self.robot.connect(port, T0) for port in (Port.COMMAND, Port.REAL, Port.RICH)}
        self._frames, self._readers = FrameReader(), {port: ReportReader() for port in Port}
        self.replies: list[Reply] = []
        self.reports: dict[Port, list[dict[str, Any]]] = {port: [] for port in Port}
        self.transaction = 0

    def _wrench(self, times: Floats) -> Floats:
        return np.tile(np.array(self.load), (len(times), 1))

    def inject(self, target: str, fault: str, **values: Any) -> Any:
        """Begin a fault."""
        from hil_xarm.faults import FORCE_FAULTS, XARM_FAULTS

        ledger = Ledger({**XARM_FAULTS, **FORCE_FAULTS})
        for device in (self.robot, self.sensor):
            for name, handlers in device.handlers.items():
                ledger.attach(name, handlers)
        self.ledger = ledger
        return ledger.inject(target, fault, self.now, values)

    def wait(self, seconds: float) -> None:
        """Let time pass, and everything that is due in it."""
        until = self.now + seconds
        while True:
            due = [at for end in self.ends.values() if end and (at := end.next_deadline()) is not None]
            now = min([*due, until])
            if now >= until - 1e-12:
                self.now = until
                self.box.advance(until)
                return
            self.now = max(self.now, now)
            for port, end in self.ends.items():
                assert end is not None
                at = end.next_deadline()
                if at is not None and at <= self.now:
                    end.handle_deadline(self.now)
                self._collect(port, end.data_to_send(self.now))

    def _collect(self, port: Port, data: bytes) -> None:
        if port is Port.COMMAND:
            self.replies += [frame.as_reply() for frame in self._frames.feed(data)]
        else:
            self.reports[port] += [
                LAYOUTS[len(report)].decode(report) for report in self._readers[port].feed(data)
            ]

    def send(self, function: int, data: bytes = b"") -> None:
        """Send a command."""
        self.transaction += 1
        end = self.ends[Port.COMMAND]
        assert end is not None
        end.receive(Request(self.transaction, 2, function, data).encode(), self.now)

    def ask(self, function: int, data: bytes = b"") -> Reply:
        """Send a command, and return its reply."""
        self.send(function, data)
        for _ in range(1000):
            self.wait(0.001)
            if self.replies and self.replies[-1].transaction == self.transaction:
                return self.replies[-1]
        raise AssertionError(f"no reply to {function}")

    def prepare(self, mode: int = Mode.SERVO) -> None:
        """Make the box ready for motions."""
        self.ask(Function.ENABLE, bytes((8, 1)))
        self.ask(Function.SET_MODE, bytes((mode,)))
        self.ask(Function.SET_STATE, b"\0")

    def servo(self, x: float, y: float, z: float) -> Reply:
        """Send a servo pose, mm, of a tool that points down."""
        return self.ask(Function.SERVO_POSE, pose_data(x, y, z))

    @property
    def report(self) -> dict[str, Any]:
        """Newest real report."""
        return self.reports[Port.REAL][-1]

    @property
    def state_and_mode(self) -> tuple[int, int]:
        """State and mode of the newest real report."""
        value = int(self.report["state_mode"][0])
        return value & 0x0F, value >> 4


def pose_data(x: float, y: float, z: float) -> bytes:
    """Return the data of a servo pose, mm, of a tool that points down."""
    return pack_floats(x, y, z, struct.unpack("<f", struct.pack("<f", np.pi))[0], 0.0, 0.0, 0.0, 0.0, 0.0)


class Pair(Desk):
    """Emulated box with a client of this package."""

    def __init__(self, client: XarmClient | ForceClient, **given: Any) -> None:
        super().__init__(**given)
        self.client = client
        self.events: list[Any] = []
        self.sent: list[tuple[float, Request]] = []
        self._requests = FrameReader()
        self.holds_back = False
        """Whether nothing of the box reaches the client."""

    def run(self, seconds: float, answer: Any = None) -> None:
        """Let time pass. `answer` is called with each event."""
        until = self.now + seconds
        self._flush()
        while True:
            due = [at for end in self.ends.values() if end and (at := end.next_deadline()) is not None]
            own = self.client.next_deadline()
            due += [] if own is None else [own]
            if min(due) > until:
                self.now = until
                return
            self.now = max(self.now, min(due))
            pieces: list[Piece] = []
            for port, end in self.ends.items():
                assert end is not None
                at = end.next_deadline()
                if at is not None and at <= self.now:
                    end.handle_deadline(self.now)
                if data := end.data_to_send(self.now):
                    self._collect(port, data)
                    pieces.append(Piece(port, data))
            if pieces and not self.holds_back:
                self.client.receive(pieces, self.now)
            self._take(answer)
            self.client.handle_deadline(self.now)
            self._take(answer)
            self._flush()

    def _take(self, answer: Any) -> None:
        while (event := self.client.next_event()) is not None:
            self.events.append(event)
            if answer is not None:
                answer(event)

    def _flush(self, pieces: Sequence[Piece] | None = None) -> None:
        for piece in self.client.data_to_send(self.now) if pieces is None else pieces:
            for frame in self._requests.feed(piece.data):
                self.sent.append((self.now, frame.as_request()))
            end = self.ends[Port.COMMAND]
            assert end is not None
            end.receive(piece.data, self.now)

    def events_of(self, kind: type) -> list[Any]:
        """Return the events of a type."""
        return [event for event in self.events if isinstance(event, kind)]
