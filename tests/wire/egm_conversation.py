"""A client of a guided robot, and the reports that it answers, in simulated time."""

from typing import Any

from protocol.devices.egm import (
    EgmClient,
    Guidance,
    Motors,
    Place,
    PoseMm,
    Rapid,
    RobotMessage,
    RobotWare,
    SensorMessage,
    decode_answer,
    encode_robot,
)
from protocol.geometry import Pose
from protocol.robot import ReportReceived, RobotReport, StreamEvent, StreamLost, StreamNotice

T0 = 1000.25
CYCLE = 0.004
DOWN = (0.0, 1.0, 0.0, 0.0)
HERE = PoseMm((600.0, 0.0, 500.0), DOWN)
STILL = (0.0,) * 6


def place(pose: PoseMm | None) -> Place:
    return Place((0.0,) * 6, pose, (), 1_700_000_000_000_000)


def robot_report(number: int, **changes: Any) -> bytes:
    """A datagram of a guided robot, four milliseconds after the previous one."""
    message = RobotMessage(
        number, 1000 + 4 * number, place(HERE), place(HERE), Motors.ON, Guidance.RUNNING, Rapid.RUNNING, False
    )
    return encode_robot(message._replace(**changes), RobotWare.RW7)


class Conversation:
    """A client whose reports are answered as by its user: with a target during a movement, otherwise with a hold."""

    def __init__(self, **settings: Any) -> None:
        self.client = EgmClient(CYCLE, **settings)
        self.goal: Pose | None = None
        self.events: list[StreamEvent] = []
        self.now = T0 - CYCLE

    def receive(self, *data: bytes, now: float | None = None) -> list[SensorMessage]:
        """Return the answers; by default one cycle after the previous datagram."""
        self.now = now = self.now + CYCLE if now is None else now
        self.client.receive(data, now)
        while (event := self.client.next_event()) is not None:
            self.events.append(event)
            if isinstance(event, ReportReceived):
                if self.goal is None:
                    self.client.hold(now)
                else:
                    self.client.target(self.goal, now)
        answers = [decode_answer(answer) for answer in self.client.data_to_send(now)]
        return [answer for answer in answers if isinstance(answer, SensorMessage)]

    def begins(self, pose: Pose) -> None:
        self.client.begin(pose)
        self.goal = pose

    @property
    def reports(self) -> list[RobotReport]:
        return [event.report for event in self.events if isinstance(event, ReportReceived)]

    def texts(self, kind: type[StreamLost] | type[StreamNotice]) -> list[str]:
        return [event.text for event in self.events if isinstance(event, kind)]
