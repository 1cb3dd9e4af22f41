"""`hil-bridge probe robot`: find the settings under which a controller answers, and write them down."""

import asyncio
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, quote, urlencode

import click

from hil_bridge.clock import Clock, run_real
from hil_bridge.device_commands.s3.prober import ProbeEvent, Prober, Said, profile_of
from hil_bridge.device_commands.s3.search import (
    LINE_WRONG,
    Finding,
    Outcome,
    Reply,
    Search,
    Try,
    likely_lines,
)
from hil_bridge.devices.kinds import KindSettings, default_settings
from hil_bridge.devices.robots.s3.room import ROBOT as S3
from hil_bridge.devices.robots.s3.room import robot_wire
from hil_bridge.devices.robots.s3.settings import S3Settings
from hil_bridge.errors import DeviceError, TransportUnavailable
from hil_bridge.errors.text_files import toml_pair
from hil_bridge.record.files import check_place, write_whole
from hil_bridge.site.robot_probe import FOUND, TO_FILL_IN
from hil_bridge.transports import LineSettings, Parity, Transport, connect_bytes
from hil_bridge.transports.pump import Pump
from hil_bridge.transports.urls import CONNECT_BYTES, parse_url
from protocol.devices.s3.adlp import DEFAULT_PROFILE, LinkProfile, settings_of_profile
from protocol.endpoint import Trouble

PATIENCE_S = 0.7
"""Longest wait for an ACK. Chosen: a device that answers at all does so within some tens of milliseconds."""
ANSWER_PATIENCE_S = 3.0
"""Longest wait for the answer to an acknowledged query. Chosen."""


def probe_robot(
    url: str,
    out: Path | None,
    patience: float,
    overwrite: bool = False,
    say: Callable[[str], object] = click.echo,
) -> tuple[str, KindSettings[Any, Any]]:
    """Probe in real time, one line a try to `say`; write what works to `out`, over a file there only with `overwrite`.
    Gives the URL and the settings that work.

    Raises ConfigError for the URL or the file, TransportUnavailable for the wire, DeviceError when nothing works.
    """
    if out is not None:
        check_place(out, overwrite)
    log: list[tuple[Try, Outcome]] = []

    def tell(attempt: Try, outcome: Outcome) -> None:
        log.append((attempt, outcome))
        say(f"{try_text(attempt):<58} {outcome.reply}" + (f": {outcome.text}" if outcome.text else ""))

    async def main() -> Finding | None:
        clock = Clock.running()
        try:
            return await probe(url, clock, patience, tell, lambda text: say(f"robot says: {text}"))
        finally:
            clock.close()

    finding = run_real(main)
    if finding is None:
        trouble = find_trouble(url, log)
        raise DeviceError(trouble.fact, remedy=trouble.remedy)
    if out is not None:  # before more is said: the reader may have gone
        write_whole(out, site_toml(url, finding).encode(), overwrite)
    say("\n" + "\n".join(f"{name:<14} {value}" for name, value in finding_rows(url, finding)))
    if out is not None:
        say(f"\nwrote {out}")
    say("")
    return (url if finding.line is None else url_with_line(url, finding.line)), link_settings(finding)


def link_settings(finding: Finding) -> KindSettings[Any, Any]:
    """Return the settings of a robot whose link was found."""
    link = LinkProfile(
        **{
            **settings_of_profile(finding.profile),
            "profile": finding.profile,
            "length_style": finding.length_style,
            "dle_stuffing": finding.dle_stuffing,
        }
    )
    return replace(default_settings(S3), client=S3Settings(link=link))


async def probe(
    url: str,
    clock: Clock,
    patience: float,
    on_try: Callable[[Try, Outcome], object],
    on_said: Callable[[str], object],
) -> Finding | None:
    """Return the settings under which the robot behind a URL answers, or None.

    `on_try` is told of each try when it has ended, `on_said` what the robot says by itself. Raises ConfigError for
    the URL, TransportUnavailable when the wire cannot be opened at all, TransportError when it breaks.
    """
    _, link = robot_wire(url, LinkProfile())
    settable = "baudrate" in CONNECT_BYTES[parse_url(url, CONNECT_BYTES).scheme].options
    named = LineSettings(link.baudrate, Parity(link.parity), link.stop_bits)
    plan = Search(likely_lines(named) if settable else (None,))
    opened = False
    while (attempt := plan.attempt) is not None:
        line = attempt.line
        try:
            session = await _Session.opened(url if line is None else url_with_line(url, line), clock, on_said)
        except TransportUnavailable as error:
            if not opened:
                raise
            outcome = Outcome(Reply.UNAVAILABLE, str(error))
            on_try(attempt, outcome)
            plan.take(outcome)
            continue
        opened = True
        try:
            while attempt is not None and attempt.line == line:
                outcome = await session.ask(attempt, patience)
                on_try(attempt, outcome)
                plan.take(outcome)
                attempt = plan.attempt
        finally:
            await session.aclose()
    return plan.finding


class _Session:
    """An open wire on which one query after the other is asked."""

    def __init__(self, wire: Transport[bytes], clock: Clock, on_said: Callable[[str], object]) -> None:
        self._wire = wire
        self._loop = clock.loop
        self._on_said = on_said
        self._prober = Prober()
        self._outcome: asyncio.Future[Outcome] = clock.loop.create_future()
        self._failure: BaseException | None = None
        self._pump: Pump[bytes, ProbeEvent] = Pump(self._prober, wire, clock, self._take, self._ended)
        self._pump.start()

    @classmethod
    async def opened(cls, url: str, clock: Clock, on_said: Callable[[str], object]) -> "_Session":
        return cls(await connect_bytes(url, clock), clock, on_said)

    async def aclose(self) -> None:
        await self._wire.aclose()

    async def ask(self, attempt: Try, patience: float) -> Outcome:
        """Ask once, and wait for what comes of it. Raises TransportError when the wire ends."""
        if self._failure is not None:
            raise self._failure
        self._outcome = self._loop.create_future()
        self._prober.ask(attempt.query, profile_of(attempt, patience, ANSWER_PATIENCE_S))
        self._pump.kick()
        return await self._outcome

    def _take(self, event: ProbeEvent) -> None:
        match event:
            case Said(text):
                self._on_said(text)
            case Outcome() if not self._outcome.done():
                self._outcome.set_result(event)

    def _ended(self, cause: BaseException) -> None:
        self._failure = cause
        with suppress(asyncio.InvalidStateError):
            self._outcome.set_exception(cause)
            self._outcome.exception()  # marks it as seen, also when the waiting task is gone


def url_with_line(url: str, line: LineSettings) -> str:
    """Return the URL with these line settings in place of its own."""
    head, _, query = url.partition("?")
    options = dict(parse_qsl(query, keep_blank_values=True))
    options |= {"baudrate": str(line.baudrate), "parity": line.parity.value, "stopbits": str(line.stopbits)}
    return f"{head}?{urlencode(options, safe='/', quote_via=quote)}"


def line_text(line: LineSettings | None) -> str:
    """Rate and format as people write them."""
    return "line as it is" if line is None else f"{line.baudrate} 8{line.parity.value}{line.stopbits}"


def try_text(attempt: Try) -> str:
    """Describe a try."""
    stuffing = "doubled" if attempt.dle_stuffing == "double" else "single"
    query = attempt.query.name.lower()
    return f"{line_text(attempt.line)}, length {attempt.length_style}, 10h {stuffing}, {query} status"


def finding_rows(url: str, finding: Finding) -> list[tuple[str, str]]:
    """Return the findings as a table of two columns."""
    stuffing = finding.dle_stuffing
    evidence = finding.stuffing_evidence or "not decided: a query with 10h was refused either way"
    return [
        ("line", line_text(finding.line)),
        ("profile", f"{finding.profile} ({profile_evidence(finding)})"),
        ("length_style", finding.length_style),
        ("dle_stuffing", f"{stuffing} ({evidence})"),
        ("url", url if finding.line is None else url_with_line(url, finding.line)),
    ]


def profile_evidence(finding: Finding) -> str:
    """Why this profile: which lengths the controller answered."""
    answered = " and ".join(finding.answered)
    if finding.profile == DEFAULT_PROFILE:
        return f"length {answered} answered"
    return f"length {answered} answered; with this set a real S3 has been moved"


def site_toml(url: str, finding: Finding) -> str:
    """Return a configuration file with the settings that work, and as comments those that an operator must know."""
    line, evidence = finding.line, finding.stuffing_evidence
    rows = [
        *FOUND,
        toml_pair("url", f"s3+{url if line is None else url_with_line(url, line)}"),
        "",
        "[robot.s3.link]",
    ]
    rows += [
        f"# {profile_evidence(finding)}; no probe can try STX and the length of moves",
        toml_pair("profile", finding.profile),
    ]
    if line is not None:
        rows += [
            toml_pair("baudrate", line.baudrate),
            toml_pair("parity", line.parity.value),
            toml_pair("stop_bits", line.stopbits),
        ]
    rows += [
        toml_pair("length_style", finding.length_style),
        f"# {evidence or 'not decided: a query with 10h was refused either way'}",
        toml_pair("dle_stuffing", finding.dle_stuffing),
    ]
    return "\n".join(rows) + "\n" + TO_FILL_IN


def find_trouble(url: str, log: list[tuple[Try, Outcome]]) -> Trouble:
    """Why nothing was found, and what to do."""
    replies = [outcome.reply for _, outcome in log]
    reached = next((attempt for attempt, outcome in log if outcome.reply not in LINE_WRONG), None)
    if reached is not None:
        return Trouble(
            f"{url}: something acknowledges bids at {line_text(reached.line)} but takes no read status",
            "`hil-bridge monitor` shows what goes over the line",
        )
    if Reply.BID_REFUSED in replies:
        return Trouble(
            f"{url}: every bid was refused", "give the link control at the pendant (TO SC) and try again"
        )
    if Reply.NOISE in replies:
        return Trouble(
            f"{url}: only noise comes back, at every rate and parity",
            "check the wiring: crossed 2-3, 3-2, and 5-5",
        )
    return Trouble(
        f"{url}: no answer at any rate and parity",
        "check that the controller is on, the cable is crossed (2-3, 3-2, 5-5), the pendant has given the link control "
        "(TO SC) and no other program uses the link",
    )
