"""Probe of a robot: its rate, its position, and the reasons why a run would not begin. Nothing is ordered."""

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
"""Chosen: longest wait for the first report; including the count after it, the result takes at most 5 s."""
COUNT_S = 0.5
"""Chosen: time for which reports are counted."""
NOTICES_MAX = 8
"""Chosen: most notices of a robot that are listed."""


class ProbeResult(NamedTuple):
    """Findings of a probe."""

    rows: tuple[tuple[str, str], ...]
    """Names and texts, for display."""
    refusals: tuple[Trouble, ...] = ()
    """Reasons why a run would not begin now; empty if there are none."""

    def with_more(self, other: "ProbeResult") -> "ProbeResult":
        """Return these findings with others of the same robot."""
        return ProbeResult(self.rows + other.rows, self.refusals + other.refusals)


class _ReceiveOnlyWire(Generic[_Data]):
    """Wire over which nothing is sent."""

    def __init__(self, wire: Transport[_Data]) -> None:
        self.name, self.start, self.aclose = wire.name, wire.start, wire.aclose

    def send(self, data: _Data) -> None:
        """Discard it."""


def mute(wiring: Wiring) -> Wiring:
    """Return the wiring of a robot that sends first: it is received from and not answered."""

    def wrap(device: str, wire: Transport[Any]) -> Transport[Any]:
        return _ReceiveOnlyWire(wiring.wrap(device, wire))

    return replace(wiring, wrap=wrap)


async def probe_link(
    url: str, connect: Callable[[Wiring], Awaitable[RobotLink]], wiring: Wiring
) -> ProbeResult:
    """Probe a robot that `connect` opens at a URL. Nothing is ordered, and the robot is not made ready.

    Raises TransportUnavailable for the wire, BridgeError if nothing answers. Notices that arrived without an answer are
    findings.
    """
    notices: list[tuple[str, str]] = []

    def note(kind: str, text: str) -> None:
        if len(notices) < NOTICES_MAX and (kind, text) not in notices:
            notices.append((kind, text))

    clock, until = wiring.clock, wiring.clock.now() + FIRST_S
    link = await first_answer(url, connect(replace(wiring, log=CallbackLog(notice=note))))
    reports: list[RobotReport] = []
    rows = [("robot", link.facts.model)]
    try:
        link.start()
        ended = await _wait_for_first(link, clock, until, reports)
        if reports and link.facts.pacing is Pacing.STREAMED:
            counted = link.counters[PACKETS]
            ended = await _collect_reports(link, clock, reports)
            rows.append(("rate", _rate_text(reports, link.counters[PACKETS] - counted, link.facts.cycle_s)))
    finally:
        await link.aclose()
    notices = [row for row in notices if ended is None or row[1] != str(ended)]
    if ended is not None and not (reports or notices):
        raise ended
    if reports:
        rows += _rows_of(reports[-1], ended is not None)
        rows += [
            ("wire", f"{link.counters[name]} {name}") for name in link.facts.errors if link.counters[name]
        ]
    return ProbeResult((*rows, *notices), _refusals(reports, ended))


def _rows_of(newest: RobotReport, ended: bool) -> list[tuple[str, str]]:
    """Return the findings of the newest report, for display; `ended` if no more reports followed."""
    x, y, z = (1e3 * value for value in newest.pose.position)
    known = all(map(math.isfinite, (x, y, z)))
    rows = [("position", f"{x:.1f} {y:.1f} {z:.1f} mm" if known else "invalid")]
    if newest.force is not None:
        rows.append(("own force", "{:.1f} {:.1f} {:.1f} N".format(*newest.force)))
    return [*rows, ("state", newest.fault or ("unknown: its packets have ended" if ended else "ready"))]


def _refusals(reports: list[RobotReport], ended: BridgeError | None) -> tuple[Trouble, ...]:
    """Return the reason why a run would not begin: the reported fault, or the end of the reports."""
    if reports and (newest := reports[-1]).fault:
        return (Trouble(newest.fault, newest.remedy),)
    return () if ended is None else (Trouble(ended.fact, ended.remedy),)


async def first_answer(name: str, answer: Awaitable[_Answer]) -> _Answer:
    """Wait for the answer to a request of a probe. Raises DeviceError if none comes in time."""
    try:
        async with asyncio.timeout(FIRST_S):
            return await answer
    except TimeoutError:
        raise DeviceError(
            f"robot on {name} does not answer within {FIRST_S:g} s",
            remedy="check its address, its cable and its power",
        ) from None


async def _wait_for_first(
    link: RobotLink, clock: Clock, until: float, reports: list[RobotReport]
) -> BridgeError | None:
    """Wait for the first report; return the error if none came. A stream that pauses is given time."""
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


async def _collect_reports(link: RobotLink, clock: Clock, reports: list[RobotReport]) -> BridgeError | None:
    """Collect reports for a short time; return the error by which the stream ended, if it did."""
    until = clock.now() + COUNT_S
    while clock.now() < until:
        try:
            reports.append(await link.report())
        except (DeviceError, TransportError) as error:
            return error
    return None


def _rate_text(reports: list[RobotReport], packets: int, cycle_s: float | None) -> str:
    """Describe the rate of the packets after the first of these reports, and the configured one."""
    passed = reports[-1].received_at - reports[0].received_at
    expected = f"; {1.0 / cycle_s:.0f} Hz by its settings" if cycle_s else ""
    if passed <= 0.0 or packets < 1:
        return f"one packet only{expected}"
    return f"{packets / passed:.0f} Hz{expected}"
