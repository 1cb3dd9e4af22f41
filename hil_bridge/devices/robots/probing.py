"""A look at a robot that orders nothing: its rate, where it stands, and the reasons for which a run would not begin."""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import replace
from typing import Any, Generic, NamedTuple, TypeVar

from hil_bridge.clock import Clock
from hil_bridge.devices.device_log import LogTo
from hil_bridge.devices.facts import Pacing
from hil_bridge.devices.robots.seam import RobotLink, RobotReport
from hil_bridge.devices.wiring import Wiring
from hil_bridge.errors import DeviceError, TransportError
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


class Probed(NamedTuple):
    """Findings of a probe."""

    rows: tuple[tuple[str, str], ...]
    """Names and texts, for people."""
    refusals: tuple[Trouble, ...] = ()
    """Reasons for which a run would not begin now; empty for none."""

    def with_more(self, other: "Probed") -> "Probed":
        """These findings and others of the same robot."""
        return Probed(self.rows + other.rows, self.refusals + other.refusals)


class _Muted(Generic[_Data]):
    """A wire over which nothing is sent."""

    def __init__(self, wire: Transport[_Data]) -> None:
        self.name, self.start, self.aclose = wire.name, wire.start, wire.aclose

    def send(self, data: _Data) -> None:
        """Forget it."""


def muted(wiring: Wiring) -> Wiring:
    """The wiring of a robot that speaks first: it is heard, and gets no answer."""

    def wrap(device: str, wire: Transport[Any]) -> Transport[Any]:
        return _Muted(wiring.wrap(device, wire))

    return replace(wiring, wrap=wrap)


async def probe_link(connect: Callable[[Wiring], Any], wiring: Wiring) -> Probed:
    """Findings of a robot that `connect` opens. Nothing is ordered, and nothing is made ready.

    Raises TransportUnavailable for the wire, DeviceError where nothing answers.
    """
    said: list[tuple[str, str]] = []

    def note(kind: str, text: str) -> None:
        if len(said) < NOTICES_MAX and (kind, text) not in said:
            said.append((kind, text))

    link: RobotLink = await connect(replace(wiring, log=LogTo(notice=note)))
    rows = [("robot", link.facts.model)]
    try:
        link.start()
        first = await _first_report(link, wiring.clock)
        reports, refusals = [first], []
        if link.facts.pacing is Pacing.STREAMED:
            refusals += await _hear_more(link, wiring.clock, reports)
            rows.append(("rate", _rate_text(reports, link.facts.cycle_s)))
    finally:
        await link.aclose()
    newest = reports[-1]
    x, y, z = (1e3 * value for value in newest.pose.position)
    rows.append(("position", f"{x:.1f} {y:.1f} {z:.1f} mm"))
    if newest.force is not None:
        rows.append(("own force", "{:.1f} {:.1f} {:.1f} N".format(*newest.force)))
    rows.append(("state", newest.fault or "ready"))
    if newest.fault:
        refusals.insert(0, Trouble(newest.fault, newest.remedy))
    return Probed((*rows, *said), tuple(refusals))


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


async def _first_report(link: RobotLink, clock: Clock) -> RobotReport:
    """The first report. A stream that pauses is given time; its last error tells why nothing came."""
    until = clock.now() + FIRST_S
    while True:
        begun = clock.now()
        try:
            return await first_answer(link.name, link.report())
        except DeviceError:
            if clock.now() >= until or clock.now() == begun:
                raise


async def _hear_more(link: RobotLink, clock: Clock, reports: list[RobotReport]) -> list[Trouble]:
    """Hear the reports of a short while; the trouble by which the stream ended, if it did."""
    until = clock.now() + LOOK_S
    while clock.now() < until:
        try:
            reports.append(await link.report())
        except (DeviceError, TransportError) as error:
            return [Trouble(error.fact, error.remedy)]
    return []


def _rate_text(reports: list[RobotReport], cycle_s: float | None) -> str:
    """The rate of these reports beside the one that is set."""
    first, last = reports[0], reports[-1]
    passed, count = last.received_at - first.received_at, last.sequence - first.sequence
    expected = f"; {1.0 / cycle_s:.0f} Hz by its settings" if cycle_s else ""
    if passed <= 0.0 or count < 1:
        return f"one packet only{expected}"
    return f"{count / passed:.0f} Hz{expected}"
