"""Emulated controller of Universal Robots with clients at its ports, on a simulated clock and without a wire."""

from collections.abc import Callable
from typing import Any

from emulators.devices.rtde import RTDE_FAULTS, RtdeProfile, RtdeRobot
from emulators.faults import Ledger
from emulators.seams import StartPose
from protocol.devices.rtde import packets
from protocol.devices.rtde.client import RtdeClient
from protocol.devices.rtde.fields import Recipe, Value
from protocol.devices.rtde.packets import Kind, Packet, Reader
from protocol.devices.rtde.profile import ClientProfile
from protocol.devices.rtde.wires import CLIENT_PORTS, Piece, Port
from protocol.endpoint import Trouble
from protocol.geometry import Pose, towards
from protocol.robot import ReportReceived, RobotReport, StreamLost
from tests.emulation.exact_arm import EXACT
from tools.register_program import register_program

T0 = 1000.25
START = StartPose((0.9, -0.1, 0.6), (0.0, 1.0, 0.0, 0.0), 0.2)
DT = 0.002
CONTROL = register_program()


class Plug:
    """Client's end of one connection: data it sends arrive at once, data it receives are stored."""

    def __init__(self, desk: "Desk", port: Port) -> None:
        server = desk.robot.connect(port, desk.now)
        assert server is not None
        self.server, self._desk = server, desk
        self.got = b""
        self._reader = Reader()
        self.take()

    def send(self, data: bytes) -> None:
        self.server.receive(data, self._desk.now)
        self.take()

    def take(self) -> None:
        data = self.server.data_to_send(self._desk.now)
        self.got += data
        self._reader.feed(data)

    def packets(self) -> list[Packet]:
        result = []
        while (packet := self._reader.next_packet()) is not None:
            result.append(packet)
        return result

    def ask(self, packet: bytes) -> Packet:
        self.send(packet)
        return self.packets()[-1]

    def line(self, command: str) -> str:
        before = len(self.got)
        self.send(f"{command}\n".encode())
        return self.got[before:].decode().removesuffix("\n")


class Desk:
    """Controller, its connections, and the time."""

    def __init__(self, profile: RtdeProfile = EXACT, start: StartPose = START) -> None:
        self.now = T0
        self.robot = RtdeRobot(profile, start, T0, 7)
        self.controller = self.robot.controller
        self.plugs: list[Plug] = []
        self.ledger = Ledger(RTDE_FAULTS)
        for target, handlers in self.robot.handlers.items():
            self.ledger.attach(target, handlers)

    def plug(self, port: Port = Port.RTDE, version: int | None = packets.PROTOCOL_VERSION) -> Plug:
        """Open a connection; an RTDE connection requests a protocol version or, like an early client, none."""
        plug = Plug(self, port)
        self.plugs.append(plug)
        if port is Port.RTDE and version is not None:
            plug.send(packets.version_request(version))
            plug.packets()
            plug.got = b""
        return plug

    def unplug(self, plug: Plug, port: Port = Port.RTDE) -> None:
        self.plugs.remove(plug)
        self.robot.leave(port, plug.server, self.now)

    def run(self, seconds: float, each: Callable[[], object] = lambda: None) -> None:
        """Let time pass, cycle by cycle; `each` is called after every cycle."""
        for _ in range(round(seconds / self.controller.period)):
            self.now += self.controller.period
            self.controller.advance(self.now)
            for plug in self.plugs:
                due = plug.server.next_deadline()
                if due is not None and due <= self.now + 1e-9:
                    plug.server.handle_deadline(self.now)
                plug.take()
            self.ledger.handle_deadline(self.now)
            each()

    def upload(self, text: str) -> None:
        script = self.plug(Port.SCRIPT)
        script.send(text.encode())
        self.plugs.remove(script)

    def inject(self, on: str, fault: str, **values: object) -> Any:
        return self.ledger.inject(on, fault, self.now, values)

    @property
    def place(self) -> tuple[float, float, float]:
        return self.controller.path.pose.position


def outputs_of(plug: Plug, *names: str, rate: float = 500.0) -> Recipe:
    answer = packets.read_types(plug.ask(packets.outputs_request(names, rate)).payload)
    assert answer.recipe == 1
    return Recipe(1, names, answer.types)


def inputs_of(plug: Plug, *names: str) -> Recipe:
    answer = packets.read_types(plug.ask(packets.inputs_request(names)).payload)
    return Recipe(answer.recipe, names, answer.types)


def values_of(plug: Plug, recipe: Recipe) -> list[dict[str, Value]]:
    return [recipe.values(recipe.unpack(p.payload)) for p in plug.packets() if p.kind == Kind.DATA]


class Pair(Desk):
    """Our client at the controller's three ports."""

    def __init__(self, profile: RtdeProfile = EXACT, client: ClientProfile | None = None) -> None:
        super().__init__(profile)
        self.profile = client or ClientProfile()
        self.ports = {port: self.plug(port) for port in CLIENT_PORTS}
        self.client = RtdeClient(self.profile, self.now)
        self.reports: list[RobotReport] = []
        self.lost: list[str] = []
        self.goal: Pose | None = None
        self.speed = 0.1
        self.set_point: Pose | None = None
        self.sent: list[bytes] = []
        self.exchange()

    def exchange(self) -> None:
        for _ in range(10):
            for port, plug in self.ports.items():
                if plug.got:
                    data, plug.got = plug.got, b""
                    self.client.receive((Piece(port, data),), self.now)
                self._events()
            pieces = self.client.data_to_send(self.now)
            if not pieces:
                return
            for piece in pieces:
                self.sent.append(piece.data)
                self.ports[piece.port].send(piece.data)

    def _events(self) -> None:
        while (event := self.client.next_event()) is not None:
            match event:
                case ReportReceived(report=report):
                    self.reports.append(report)
                    if self.goal is None or self.set_point is None:
                        self.client.hold(self.now)
                    else:
                        self.set_point = towards(self.set_point, self.goal, self.speed * DT, 0.35 * DT)
                        self.client.target(self.set_point, self.now)
                case StreamLost(text=text, remedy=remedy):
                    self.lost.append(str(Trouble(text, remedy)))

    def step(self) -> None:
        due = self.client.next_deadline()
        if due is not None and due <= self.now:
            self.client.handle_deadline(self.now)
            self._events()
        self.exchange()

    def pass_time(self, seconds: float) -> None:
        self.run(seconds, self.step)

    def begin(self, dx: float = 0.0, dz: float = 0.0) -> None:
        pose = self.reports[-1].pose
        x, y, z = pose.position
        self.set_point, self.goal = pose, Pose((x + dx, y, z + dz), pose.quaternion)
        self.client.begin(pose)

    def end(self) -> None:
        self.goal = None
        self.client.end()
        self.exchange()

    @property
    def fault(self) -> str:
        report = self.reports[-1]
        return str(Trouble(report.fault, report.remedy))


def ready(profile: RtdeProfile = EXACT, client: ClientProfile | None = None) -> Pair:
    pair = Pair(profile, client)
    pair.pass_time(0.2)
    assert pair.reports, pair.lost
    return pair
