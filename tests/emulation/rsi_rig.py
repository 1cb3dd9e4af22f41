"""Emulated KUKA controller and a client that answers it, cycle by cycle on a simulated clock."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from emulators.devices.rsi import RSI_FAULTS, RsiController, RsiProfile
from emulators.faults import Ledger
from emulators.seams import StartPose
from protocol.devices.rsi import SENSOR, Telegram, decode, encode, fixed, numbers, pose_tags

T0 = 1000.0
DOWN = (0.0, 1.0, 0.0, 0.0)
PLAIN = ("DEF_RIst", "DEF_RSol", "DEF_AIPos", "DEF_ASPos", "DEF_Delay")
QUICK: dict[str, Any] = {"send": PLAIN, "move_after_ms": 0.0, "restart_s": 0.0}


def answer(ipoc: int, x: float = 0.0, y: float = 0.0, z: float = 0.0, c: float = 0.0, **more: str) -> bytes:
    values = (x, y, z, 0.0, 0.0, c)
    texts = {tag: fixed(value, 6) for tag, value in zip(pose_tags("RKorr"), values, strict=True)}
    return encode(Telegram(SENSOR, "ImFree", {**texts, **more}, ipoc))


@dataclass
class Rig:
    """Controller, run cycle by cycle."""

    profile: RsiProfile
    now: float = T0
    sent: list[Telegram] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.robot = RsiController(self.profile, StartPose((0.6, 0.0, 0.5), DOWN), T0)
        self.ledger = Ledger(RSI_FAULTS)
        for target, handlers in self.robot.handlers.items():
            self.ledger.attach(target, handlers)

    def next(self, *, plain: bool = True) -> list[bytes]:
        """Return the output at the next moment at which the controller acts."""
        due = self.robot.endpoint.next_deadline()
        assert due is not None
        self.now = due
        self.robot.endpoint.handle_deadline(due)
        out = [bytes(raw) for raw in self.robot.endpoint.data_to_send(due)]
        if plain:
            self.sent += [decode(raw) for raw in out]
        return out

    def cycle(self, *replies: Callable[[int], bytes]) -> Telegram:
        """Return the next telegram, and answer it."""
        (raw,) = self.next()
        telegram = decode(raw)
        self.robot.endpoint.receive([reply(telegram.ipoc) for reply in replies], self.now + 0.001)
        return telegram

    def run(self, cycles: int, **value: Any) -> None:
        for _ in range(cycles):
            self.cycle(lambda ipoc: answer(ipoc, **value))

    def z(self) -> float:
        return self.robot.correction[2]

    def height_mm(self) -> float:
        """Return the true height of the arm after all lag, mm."""
        path = self.robot.path
        positions, _ = path.trajectory(np.array([self.now]))
        return float(positions[0, 2]) * 1e3


def rig(**settings: Any) -> Rig:
    return Rig(RsiProfile(**{**QUICK, **settings}))


def actual(telegram: Telegram) -> list[float]:
    result = numbers(telegram.values, pose_tags("RIst"))
    assert result is not None
    return result
