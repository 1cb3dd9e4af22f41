"""Emulated controller with EGM and a computer that answers it, cycle by cycle on a simulated clock."""

from collections.abc import Callable, Sequence
from typing import Any

from emulators.devices.egm import EGM_FAULTS, EgmController, EgmProfile
from emulators.faults import Injection, Ledger
from emulators.seams import StartPose
from protocol.devices.egm import (
    Answer,
    Guidance,
    Motors,
    PoseMm,
    Rapid,
    RobotMessage,
    SensorMessage,
    decode_robot,
    encode_answer,
)

T0 = 1234.5
CYCLE = 0.004
DOWN = (0.0, 1.0, 0.0, 0.0)
START = PoseMm((900.0, -100.0, 600.0), DOWN)
AT_ONCE = {"lp_hz": 0.0, "ramp_in_s": 0.0, "ref_delay_cycles": 0}
"""Settings without filter, ramp and delay: the control law alone."""
Responder = Callable[[RobotMessage | None], Sequence[Answer | bytes]]


def at(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> PoseMm:
    """Return a pose at this offset from the start, mm."""
    p, q, r = START.position_mm
    return PoseMm((p + x, q + y, r + z), DOWN)


def to(x: float = 0.0, y: float = 0.0, z: float = 0.0, speed: tuple[float, ...] = ()) -> SensorMessage:
    return SensorMessage(0, 0, at(x, y, z), speed=speed)


class Line:
    """Controller, and a PC that answers each cycle."""

    def __init__(self, **settings: Any) -> None:
        self.robot = EgmController(EgmProfile(**settings), StartPose((0.9, -0.1, 0.6), DOWN, 0.2), T0, 7)
        self.received: list[RobotMessage] = []
        self.now = T0
        self.ledger = Ledger(EGM_FAULTS)
        for target, handlers in self.robot.handlers.items():
            self.ledger.attach(target, handlers)

    def cycles(self, count: int, respond: Responder = lambda received: ()) -> "Line":
        """Run this many cycles; the PC answers half a millisecond after each datagram, or receives nothing."""
        for _ in range(count):
            due = self.robot.endpoint.next_deadline()
            assert due is not None
            self.now = due
            self.ledger.handle_deadline(due)
            self.robot.endpoint.handle_deadline(due)
            reported = [decode_robot(datagram) for datagram in self.robot.endpoint.data_to_send(due)]
            self.received += reported
            self.send(*respond(reported[-1] if reported else None))
        return self

    def send(self, *messages: Answer | bytes) -> None:
        data = [one if isinstance(one, bytes) else encode_answer(one) for one in messages]
        self.robot.endpoint.receive(data, self.now + 0.0005)

    def answers(self, message: Answer) -> "Line":
        """Run one cycle with these answers."""
        return self.cycles(1, lambda received: [message])

    def streams(self, seconds: float, message: Answer | bytes) -> "Line":
        return self.cycles(round(seconds / CYCLE), lambda received: [message])

    @property
    def last(self) -> RobotMessage:
        return self.received[-1]

    def z(self, count: int = 1) -> list[float]:
        """Return the height of the set point in the newest datagrams, mm above the start."""
        return [round(planned(message).position_mm[2] - 600.0, 9) for message in self.received[-count:]]

    def inject(self, target: str, fault: str, for_s: float | None = None, **values: Any) -> Injection:
        """Inject a fault from now on, as a cell does."""
        parameters = values if for_s is None else {**values, "for_s": for_s}
        return self.ledger.inject(target, fault, self.now + 0.001, parameters)


def planned(message: RobotMessage) -> PoseMm:
    assert message.planned is not None
    assert message.planned.pose is not None
    return message.planned.pose


def measured(message: RobotMessage) -> PoseMm:
    assert message.feedback is not None
    assert message.feedback.pose is not None
    return message.feedback.pose


def states(message: RobotMessage) -> tuple[Motors, Guidance, Rapid]:
    return message.motors, message.guidance, message.rapid
