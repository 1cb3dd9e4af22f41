"""Emulated S3 and the project's own host, over a wire without delay on a simulated clock."""

from collections.abc import Iterator

import numpy as np

from emulators.devices.s3 import S3_CONTROLS, S3Controller, S3Profile, S3Profiles, S3Site
from emulators.panel import Panel
from emulators.seams import StartPose
from protocol.devices.s3.adlp import LinkProfile
from protocol.devices.s3.arap import (
    Answered,
    ArapEvent,
    ArapHost,
    Mode,
    Move,
    MoveKind,
    OrderFailed,
    Refused,
    Status,
    Telegram,
    read_status,
    start_program,
    stop_program,
    write_mode,
)

T0 = 4000.375
START = (0.9, -0.1, 0.6)
DOWN = (0.0, 1.0, 0.0, 0.0)
PROFILE = S3Profile()


class Bench:
    """Controller, its panel and a host."""

    def __init__(self, profile: S3Profile = PROFILE, **programs: bytes) -> None:
        site = S3Site(programs={int(name.removeprefix("p")): text for name, text in programs.items()})
        self.now = T0
        self.robot = S3Controller(S3Profiles(profile), StartPose(START, DOWN, 0.2), T0, 1, site)
        self.panel = Panel(self.robot, S3_CONTROLS, self.robot.faults)
        self.host = ArapHost(LinkProfile())
        self.events: list[ArapEvent] = []
        self.to_host = bytearray()
        """All bytes that the controller has sent."""

    def exchange(self) -> None:
        """Exchange bytes until neither side has more to send."""
        while True:
            to_robot = self.host.data_to_send(self.now)
            if to_robot:
                self.robot.endpoint.receive(to_robot, self.now)
            to_host = self.robot.endpoint.data_to_send(self.now)
            if to_host:
                self.to_host += to_host
                self.host.receive(to_host, self.now)
            while (event := self.host.next_event()) is not None:
                self.events.append(event)
            if not to_robot and not to_host:
                return

    def steps(self, seconds: float) -> Iterator[None]:
        """Yield every moment at which something happens within a time."""
        end = self.now + seconds
        self.exchange()
        yield
        while True:
            due = [
                at
                for at in (self.robot.endpoint.next_deadline(), self.host.next_deadline())
                if at is not None
            ]
            if not due or min(due) > end:
                self.now = end
                return
            self.now = max(self.now, min(due))
            self.robot.endpoint.handle_deadline(self.now)
            self.host.handle_deadline(self.now)
            self.exchange()
            yield

    def wait(self, seconds: float) -> None:
        for _ in self.steps(seconds):
            pass

    def ask(self, order: Telegram, within: float = 60.0) -> Answered | Refused | OrderFailed:
        self.host.order(order)
        for _ in self.steps(within):
            for event in self.events:
                if isinstance(event, Answered | Refused | OrderFailed):
                    self.events.remove(event)
                    return event
        raise AssertionError("no answer")

    def accepts(self, order: Telegram) -> bool:
        return isinstance(self.ask(order), Answered)

    def code(self, order: Telegram) -> int:
        answer = self.ask(order)
        assert isinstance(answer, Refused)
        return answer.refusal.code

    def status(self) -> Status:
        answer = self.ask(read_status())
        assert isinstance(answer, Answered)
        return Status.from_telegram(answer.answer)

    def count(self, name: str) -> int:
        return self.host.link.counters[name]

    def operation(self) -> "Bench":
        assert self.accepts(write_mode(Mode.OPERATION))
        return self

    def moving(self, y: float = 0.3, speed: float = 0.05) -> "Bench":
        """Return a bench during a movement sequence towards y, m."""
        assert self.operation().accepts(move(MoveKind.START))
        assert self.accepts(move(MoveKind.POINT, y, speed))
        return self

    @property
    def true_position(self) -> list[float]:
        return self.robot.motion.path.trajectory(np.array([self.now]))[0][0].tolist()


def move(kind: MoveKind, y: float = -0.1, speed: float = 0.05) -> Telegram:
    if kind is MoveKind.START:
        return Move(kind).to_telegram()
    return Move(kind, (0.9, y, 0.6), DOWN, speed).to_telegram()


POINT, BEGIN = move(MoveKind.POINT), move(MoveKind.START)
RUN, STOP, STANDBY, OPERATION = (
    start_program(1),
    stop_program(),
    write_mode(Mode.STANDBY),
    write_mode(Mode.OPERATION),
)
