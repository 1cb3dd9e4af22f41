"""Probe of a robot: its rate, its position, and the reasons why a run would not start. The probe sends no orders."""

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
"""Longest wait for the first report, s. Chosen: including the time for counting reports, the probe takes at most 5
s.
"""
COUNT_S = 0.5
"""Time for which reports are counted, s. Chosen."""
NOTICES_MAX = 8
"""Maximum number of notices of a robot that are listed. Chosen."""


class ProbeResult(NamedTuple):
    """Findings of a probe."""

    rows: tuple[tuple[str, str], ...]
    """Names and values of the findings, as text for display."""
    refusals: tuple[Trouble, ...] = ()
    """Reasons why a run would not start at present; empty if there are none."""

    def with_more(self, other: "ProbeResult") -> "ProbeResult":
        """Return these findings, extended by other findings of the same robot."""
        return ProbeResult(self.rows + other.rows, self.refusals + other.refusals)


class _ReceiveOnlyWire(Generic[_Data]):
    """Wire that receives and never sends."""

    def __init__(self, wire: Transport[_Data]) -> None:
        self.name, self.start, self.aclose = wire.name, wire.start, wire.aclose

    def send(self, data: _Data) -> None:
        """Discard the data."""


def mute(wiring: Wiring) -> Wiring:
    """Return the wiring for a robot that sends first. Data from the robot are received and not answered."""

    def wrap(device: str, wire: Transport[Any]) -> Transport[Any]:
        return _ReceiveOnlyWire(wiring.wrap(device, wire))

    return replace(wiring, wrap=wrap)


async def probe_link(
    url: str, connect: Callable[[Wiring], Awaitable[RobotLink]], wiring: Wiring
) -> ProbeResult:
    """Probe the robot that `connect` opens at a URL. No order is sent, and the robot is not made ready.

    Raises TransportUnavailable if the wire cannot be opened, BridgeError if the robot does not answer. If it sent
    notices without an answer, the notices are returned as findings.
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
    """Return the findings of the newest report for display. `ended` says that no further report followed."""
    x, y, z = (1e3 * value for value in newest.pose.position)
    known = all(map(math.isfinite, (x, y, z)))
    rows = [("position", f"{x:.1f} {y:.1f} {z:.1f} mm" if known else "invalid")]
    if newest.force is not None:
        rows.append(("own force", "{:.1f} {:.1f} {:.1f} N".format(*newest.force)))
    return [*rows, ("state", newest.fault or ("unknown: its packets have ended" if ended else "ready"))]


def _refusals(reports: list[RobotReport], ended: BridgeError | None) -> tuple[Trouble, ...]:
    """Return the reasons why a run would not start: the reported fault, or the end of the reports."""
    if reports and (newest := reports[-1]).fault:
        return (Trouble(newest.fault, newest.remedy),)
    return () if ended is None else (Trouble(ended.fact, ended.remedy),)


async def first_answer(name: str, answer: Awaitable[_Answer]) -> _Answer:
    """Wait for the answer to a probe's request. Raises DeviceError if no answer arrives in time."""
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
    """Wait for the first report. Return the error if none arrived. A paused stream is given time to resume."""
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
    """Collect reports for a short time. Return the error if the stream ended with one."""
    until = clock.now() + COUNT_S
    while clock.now() < until:
        try:
            reports.append(await link.report())
        except (DeviceError, TransportError) as error:
            return error
    return None


def _rate_text(reports: list[RobotReport], packets: int, cycle_s: float | None) -> str:
    """Describe the measured rate of the packets after the first of these reports, and the configured rate."""
    passed = reports[-1].received_at - reports[0].received_at
    expected = f"; {1.0 / cycle_s:.0f} Hz by its settings" if cycle_s else ""
    if passed <= 0.0 or packets < 1:
        return f"one packet only{expected}"
    return f"{packets / passed:.0f} Hz{expected}"
