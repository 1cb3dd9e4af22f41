"""A look at a robot that orders nothing: its rate, where it stands, and the reasons for which a run would not begin."""

import asyncio
import math
from collections.abc import Awaitable, Callable
from dataclasses import replace
from typing import Any, Generic, NamedTuple, TypeVar

from hil_bridge.clock import Clock
from hil_bridge.devices.device_log import CallbackLog
from hil_bridge.devices.facts import PACKETS, Pacing
from hil_bridge.devices.robots.seam import RobotLink, RobotReport
from hil_bridge.devices.robots.streamed import RobotSilent
from hil_bridge.devices.wiring import Wiring
from hil_bridge.errors import BridgeError, DeviceError, TransportError
from hil_bridge.transports import Transport
from protocol.endpoint import Trouble

_Answer = TypeVar("_Answer")
_Data = TypeVar("_Data")

FIRST_S = 3.5
"""Chosen: longest wait for the first report; with the look behind it an answer comes within 5 s."""
LOOK_S = 0.5
"""Chosen: for so long reports are counted."""
NOTICES_MAX = 8
"""Chosen: lines that a robot says of itself and that are shown."""


class ProbeResult(NamedTuple):
    """Findings of a probe."""

    rows: tuple[tuple[str, str], ...]
    """Names and texts, for people."""
    refusals: tuple[Trouble, ...] = ()
    """Reasons for which a run would not begin now; empty for none."""

    def with_more(self, other: "ProbeResult") -> "ProbeResult":
        """These findings and others of the same robot."""
        return ProbeResult(self.rows + other.rows, self.refusals + other.refusals)


class _ReceiveOnlyWire(Generic[_Data]):
    """A wire over which nothing is sent."""

    def __init__(self, wire: Transport[_Data]) -> None:
        self.name, self.start, self.aclose = wire.name, wire.start, wire.aclose

    def send(self, data: _Data) -> None:
        """Forget it."""


def mute(wiring: Wiring) -> Wiring:
    """The wiring of a robot that speaks first: it is heard, and gets no answer."""

    def wrap(device: str, wire: Transport[Any]) -> Transport[Any]:
        return _ReceiveOnlyWire(wiring.wrap(device, wire))

    return replace(wiring, wrap=wrap)


async def probe_link(
    url: str, connect: Callable[[Wiring], Awaitable[RobotLink]], wiring: Wiring
) -> ProbeResult:
    """Findings of a robot that `connect` opens at a URL. Nothing is ordered, and nothing is made ready.

    Raises TransportUnavailable for the wire, BridgeError where nothing answers. What came and was no answer is found.
    """
    said: list[tuple[str, str]] = []

    def note(kind: str, text: str) -> None:
        if len(said) < NOTICES_MAX and (kind, text) not in said:
            said.append((kind, text))

    clock, until = wiring.clock, wiring.clock.now() + FIRST_S
    link = await first_answer(url, connect(replace(wiring, log=CallbackLog(notice=note))))
    reports: list[RobotReport] = []
    rows = [("robot", link.facts.model)]
    try:
        link.start()
        ended = await _hear_first(link, clock, until, reports)
        if reports and link.facts.pacing is Pacing.STREAMED:
            counted = link.counters[PACKETS]
            ended = await _hear_more(link, clock, reports)
            rows.append(("rate", _rate_text(reports, link.counters[PACKETS] - counted, link.facts.cycle_s)))
    finally:
        await link.aclose()
    said = [row for row in said if ended is None or row[1] != str(ended)]
    if ended is not None and not (reports or said):
        raise ended
    if reports:
        rows += _rows_of(reports[-1], ended is not None)
        rows += [
            ("wire", f"{link.counters[name]} {name}") for name in link.facts.errors if link.counters[name]
        ]
    return ProbeResult((*rows, *said), _refusals(reports, ended))


def _rows_of(newest: RobotReport, ended: bool) -> list[tuple[str, str]]:
    """Findings of the newest report, for people; `ended` when no more came behind it."""
    x, y, z = (1e3 * value for value in newest.pose.position)
    known = all(map(math.isfinite, (x, y, z)))
    rows = [("position", f"{x:.1f} {y:.1f} {z:.1f} mm" if known else "none")]
    if newest.force is not None:
        rows.append(("own force", "{:.1f} {:.1f} {:.1f} N".format(*newest.force)))
    return [*rows, ("state", newest.fault or ("unknown: its packets have ended" if ended else "ready"))]


def _refusals(reports: list[RobotReport], ended: BridgeError | None) -> tuple[Trouble, ...]:
    """Reason for which a run would not begin: the fault that is told, else the end of the reports."""
    if reports and (newest := reports[-1]).fault:
        return (Trouble(newest.fault, newest.remedy),)
    return () if ended is None else (Trouble(ended.fact, ended.remedy),)


async def first_answer(name: str, answer: Awaitable[_Answer]) -> _Answer:
    """The answer to a question of a probe. Raises DeviceError where none comes in time."""
    try:
        async with asyncio.timeout(FIRST_S):
            return await answer
    except TimeoutError:
        raise DeviceError(
            f"robot on {name} does not answer within {FIRST_S:g} s",
            remedy="look at its address, its cable and its power",
        ) from None


async def _hear_first(
    link: RobotLink, clock: Clock, until: float, reports: list[RobotReport]
) -> BridgeError | None:
    """Wait for the first report; why none came. A stream that pauses is given time."""
    while True:
        try:
            reports.append(await first_answer(link.name, link.report()))
        except RobotSilent as silent:
            if clock.now() >= until:
                return silent
        except (DeviceError, TransportError) as error:
            return error
        else:
            return None


async def _hear_more(link: RobotLink, clock: Clock, reports: list[RobotReport]) -> BridgeError | None:
    """Hear the reports of a short while; the error by which the stream ended, if it did."""
    until = clock.now() + LOOK_S
    while clock.now() < until:
        try:
            reports.append(await link.report())
        except (DeviceError, TransportError) as error:
            return error
    return None


def _rate_text(reports: list[RobotReport], packets: int, cycle_s: float | None) -> str:
    """The rate of the packets that came behind the first of these reports, beside the one that is set."""
    passed = reports[-1].received_at - reports[0].received_at
    expected = f"; {1.0 / cycle_s:.0f} Hz by its settings" if cycle_s else ""
    if passed <= 0.0 or packets < 1:
        return f"one packet only{expected}"
    return f"{packets / passed:.0f} Hz{expected}"
