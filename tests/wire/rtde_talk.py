"""An RTDE client of a controller, and the scripted controller that it talks to."""

from protocol.devices.rtde import packets
from protocol.devices.rtde.client import RtdeClient
from protocol.devices.rtde.data_packet import EXPECTED, OUTPUT_NAMES
from protocol.devices.rtde.fields import Recipe
from protocol.devices.rtde.packets import Kind, Types
from protocol.devices.rtde.profile import ClientProfile
from protocol.devices.rtde.program import INPUT_NAMES
from protocol.devices.rtde.states import Runtime, SafetyBits
from protocol.devices.rtde.wires import Piece, Port
from protocol.endpoint import Trouble
from protocol.robot import ReportReceived, StreamLost, StreamNotice

T0 = 1000.25
FIRST = 100_001
"""First sequence number with a controller whose clock is at 100 s."""
SIX = (0.4, -0.1, 0.3, 0.0, 3.0, 0.5)
OUT = Recipe(1, OUTPUT_NAMES, EXPECTED[OUTPUT_NAMES])
IN = Recipe(3, INPUT_NAMES, EXPECTED[INPUT_NAMES])
ANSWERS = {
    Kind.VERSION: packets.accepted(Kind.VERSION, True),
    Kind.OUTPUTS: packets.types_answer(Kind.OUTPUTS, Types(1, EXPECTED[OUTPUT_NAMES])),
    Kind.INPUTS: packets.types_answer(Kind.INPUTS, Types(3, EXPECTED[INPUT_NAMES])),
    Kind.START: packets.accepted(Kind.START, True),
}
LINES = {
    "is in remote control\n": "true\n",
    "safetystatus\n": "Safetystatus: NORMAL\n",
    "robotmode\n": "Robotmode: RUNNING\n",
}
NO_DASHBOARD = ClientProfile(dashboard_port=0)


def data(
    stamp: float,
    state: int = 1,
    runtime: int = Runtime.PLAYING,
    pose: tuple[float, ...] = SIX,
    **more: float,
) -> bytes:
    """A data packet of a controller that is ready."""
    values = {"mode": 7, "safety": int(SafetyBits.NORMAL), "scaling": 1.0, "taken": FIRST, **more}
    return OUT.pack(
        stamp,
        *pose,
        *(0.0,) * 12,
        *SIX,
        runtime,
        values["mode"],
        values["safety"],
        3,
        state,
        int(values["taken"]),
        0,
        values["scaling"],
    )


class Talk:
    """A client, and everything that it has sent and reported."""

    def __init__(self, profile: ClientProfile = NO_DASHBOARD) -> None:
        self.now = T0
        self.client = RtdeClient(profile, T0)
        self.sent: list[Piece] = []
        self.lost: list[str] = []
        self.notices: list[str] = []
        self.reports: list[str] = []
        self.take()

    def take(self) -> None:
        while (event := self.client.next_event()) is not None:
            match event:
                case StreamLost(text=text, remedy=remedy):
                    self.lost.append(str(Trouble(text, remedy)))
                case StreamNotice(text=text):
                    self.notices.append(text)
                case ReportReceived(report=report):
                    self.reports.append(str(Trouble(report.fault, report.remedy)))
                    self.client.hold(self.now)
        self.sent += self.client.data_to_send(self.now)

    def hear(self, raw: bytes, port: Port = Port.RTDE) -> None:
        self.client.receive((Piece(port, raw),), self.now)
        self.take()

    def wait(self, seconds: float) -> None:
        end = self.now + seconds
        while (due := self.client.next_deadline()) is not None and due <= end:
            self.now = due
            self.client.handle_deadline(due)
            self.take()
            if self.lost:
                return
        self.now = end

    def up_to(self, kind: Kind) -> "Talk":
        """Let the controller accept everything before this packet."""
        for each, answer in ANSWERS.items():
            if each is kind:
                break
            self.hear(answer)
        return self
