"""Tables of docs/reference/probe.md: the answer of `probe robot` for each kind of robot and each fault.

The probes are repeated each time, in virtual time; they take some seconds.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from emulators.orders import Act, ReceivedOrder
from hil_bridge.clock import Clock, run_virtual
from hil_bridge.device_commands.s3 import probe as s3_probe
from hil_bridge.devices.kinds import ROBOTS
from hil_bridge.errors import BridgeError
from hil_bridge.runs.compose import emulated_cell
from hil_bridge.runs.setup import Listen, Setup
from hil_bridge.settings.configuration import load_config
from hil_bridge.site import robot_probe
from protocol.endpoint import Trouble
from tools.pages import table

KINDS = ("s3", "egm", "rtde", "rsi")
TARGETS = ("robot", "pose", "wire")
"""Targets of the faults. Faults of the robot's own force, and of a program's wire, do not matter for a probe."""
BEFORE_S = 0.2
"""Time from the start of the robot to the fault and the probe, s."""
GIVEN: Mapping[str, Mapping[str, float]] = {
    "encoder-offset": {"x_mm": 5.0},
    "offset": {"x_mm": 5.0},
    "drift": {"x_mm_s": 5.0},
    "off": {"for_s": 9.0},
}
"""Parameters of faults that, with their defaults, have no effect or end before the answer."""


class Case(NamedTuple):
    """Probe of one robot."""

    kind: str
    on: str = ""
    """Target of the fault; empty for a healthy robot."""
    fault: str = ""
    settings: Mapping[str, object] = {}
    """Settings in addition to the kind of the robot."""


@dataclass
class Look:
    """Result of a probe of an emulated robot, with the state of the robot afterwards."""

    case: Case
    url: str = ""
    rows: Sequence[tuple[str, str]] = ()
    refusals: Sequence[Trouble] = ()
    took_s: float = math.nan
    way_m: float = 0.0
    """Distance of the tool from its initial position, m."""
    accepted: int = 0
    """Number of orders that the robot has accepted."""
    acts: list[Act] = field(default_factory=list)
    """Kinds of orders that the robot has received, as reported to a judge."""

    @property
    def words(self) -> str:
        """Full text that an operator sees."""
        return "\n".join(
            (
                *(f"{name} {text}" for name, text in self.rows),
                *(f"a run would be refused: {trouble}" for trouble in self.refusals),
            )
        )


def cases(kind: str) -> Iterator[Case]:
    """Return the cases of this kind of robot: a healthy robot, and a robot with each of its faults."""
    emulation = ROBOTS.kind(kind).emulation
    assert emulation is not None
    yield Case(kind)
    for on in TARGETS:
        yield from (Case(kind, on, fault) for fault in emulation.faults[on])


def look_at(case: Case) -> Look:
    """Probe as the command does. For an S3, this includes the search for the settings of its link."""
    look = Look(case)

    async def main() -> None:
        clock = Clock.running()
        setup = Setup(load_config(None, {"robot.emulated": case.kind, **case.settings}), Listen("", None))
        async with emulated_cell(setup, clock, lambda cause: None) as served:
            robot = served.cell.robot
            assert served.robot is not None
            await clock.sleep_until(clock.now() + BEFORE_S)
            if case.fault:
                served.cell.ledger.inject(case.on, case.fault, clock.now(), GIVEN.get(case.fault, {}))
            before = _place(robot, clock.now())
            orders: list[ReceivedOrder] = []
            robot.orders.listener = orders.append
            begun = clock.now()
            try:
                await _ask(look, served.robot, clock)
            except BridgeError as error:
                look.refusals = [Trouble(error.fact, error.remedy)]
            look.took_s = clock.now() - begun
            look.way_m = math.dist(before, _place(robot, clock.now()))
            look.accepted, look.acts = robot.targets.accepted, [order.act for order in orders]
        clock.close()

    run_virtual(main)
    return look


async def _ask(look: Look, robot: Any, clock: Clock) -> None:
    settings = robot.settings
    look.url = url = robot.url
    if look.case.kind == "s3":
        tries: list[Any] = []
        finding = await s3_probe.probe(
            url, clock, s3_probe.PATIENCE_S, lambda *result: tries.append(result), lambda text: None
        )
        if finding is None:
            look.refusals = [s3_probe.find_trouble(url, tries)]
            return
        settings = s3_probe.link_settings(finding)
    findings = await robot_probe.probe(robot.kind, url, settings, clock)
    look.rows, look.refusals = findings.rows, findings.refusals


def _place(robot: Any, now: float) -> list[float]:
    """Return the true position of the tool, m."""
    robot.path.advance(now)
    positions, _ = robot.path.trajectory(np.array([now]))
    return [float(value) for value in positions[0]]


def answer(look: Look, healthy: Look) -> str:
    """Return the answer as a table cell: the refusals, or the differences from the answer of a healthy robot."""
    facts = [trouble.fact.removeprefix(f"{look.url}: ") for trouble in look.refusals]
    usual = {name for name, _ in healthy.rows} if facts else ()
    more = [
        f"{name}: {text}"
        for name, text in look.rows
        if (name, text) not in healthy.rows and name not in usual
    ]
    return "; ".join((f"refused: {', '.join(facts)}" if facts else "begins", *more)).replace(
        look.url.partition("?")[0], "URL"
    )


def answers(kind: str) -> str:
    """Return the table of a kind of robot: each answer with its faults and its longest duration."""
    looks = [look_at(case) for case in cases(kind)]
    rows = dict[str, list[Look]]()
    for look in looks:
        rows.setdefault(answer(look, looks[0]), []).append(look)
    return table(
        ("the probe says of a run", "faults", "after"),
        (
            (
                text,
                "; ".join(_faults_by_target(look.case for look in same)),
                f"{max(look.took_s for look in same):.1f} s",
            )
            for text, same in rows.items()
        ),
    )


def _faults_by_target(struck: Iterable[Case]) -> Iterator[str]:
    """Yield each target with its faults, such as `wire`: `off`, `mute`; yield none for the healthy robot."""
    by_target = dict[str, list[str]]()
    for case in struck:
        by_target.setdefault(case.on, []).append(case.fault)
    for on, faults in by_target.items():
        yield f"{on}: {', '.join(f'`{fault}`' for fault in faults)}" if on else "none"


TABLES = {kind: partial(answers, kind) for kind in KINDS}
