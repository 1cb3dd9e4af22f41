"""`hil-bridge probe robot`: detect the settings with which a controller answers, and write them to a file."""

import asyncio
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, quote, urlencode

import click

from hil_bridge.clock import Clock, run_real
from hil_bridge.device_commands.s3.prober import ProbeEvent, Prober, UnsolicitedMessage, profile_of
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
from hil_bridge.record.files import check_place, write_atomically
from hil_bridge.site.robot_probe import FOUND, TO_FILL_IN
from hil_bridge.transports import LineSettings, Parity, Transport, connect_bytes
from hil_bridge.transports.pump import Pump
from hil_bridge.transports.urls import CONNECT_BYTES, parse_url
from protocol.devices.s3.adlp import DEFAULT_PROFILE, LinkProfile, settings_of_profile
from protocol.endpoint import Trouble

PATIENCE_S = 0.7
"""Longest wait for an ACK, s. Chosen: a device that answers at all does so within some tens of milliseconds."""
ANSWER_PATIENCE_S = 3.0
"""Longest wait for the answer to an acknowledged query, s. Chosen."""


def probe_robot(
    url: str,
    out: Path | None,
    patience: float,
    overwrite: bool = False,
    say: Callable[[str], object] = click.echo,
) -> tuple[str, KindSettings[Any, Any]]:
    """Probe a controller in real time and return the URL and the settings that work. `say` receives one line per
    try. The result is written to `out`, which is replaced only with `overwrite`.

    Raises ConfigError for an invalid URL or file, TransportUnavailable if the wire cannot be opened, DeviceError if
    no settings work.
    """
    if out is not None:
        check_place(out, overwrite)
    log: list[tuple[Try, Outcome]] = []

    def report_try(attempt: Try, outcome: Outcome) -> None:
        log.append((attempt, outcome))
        say(f"{try_text(attempt):<58} {outcome.reply}" + (f": {outcome.text}" if outcome.text else ""))

    async def main() -> Finding | None:
        clock = Clock.running()
        try:
            return await probe(url, clock, patience, report_try, lambda text: say(f"robot says: {text}"))
        finally:
            clock.close()

    finding = run_real(main)
    if finding is None:
        trouble = find_trouble(url, log)
        raise DeviceError(trouble.fact, remedy=trouble.remedy)
    if out is not None:  # before more output: the reader may have closed the pipe
        write_atomically(out, site_toml(url, finding).encode(), overwrite)
    say("\n" + "\n".join(f"{name:<14} {value}" for name, value in finding_rows(url, finding)))
    if out is not None:
        say(f"\nwrote {out}")
    say("")
    return (url if finding.line is None else url_with_line(url, finding.line)), link_settings(finding)


def link_settings(finding: Finding) -> KindSettings[Any, Any]:
    """Return the settings of a robot with the link settings of a finding."""
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
    on_message: Callable[[str], object],
) -> Finding | None:
    """Return the settings with which the robot at a URL answers, or None.

    `on_try` is called after each try, `on_message` with unsolicited messages of the robot. Raises ConfigError for
    an invalid URL, TransportUnavailable if the wire cannot be opened at all, TransportError if it breaks.
    """
    _, link = robot_wire(url, LinkProfile())
    settable = "baudrate" in CONNECT_BYTES[parse_url(url, CONNECT_BYTES).scheme].options
    named = LineSettings(link.baudrate, Parity(link.parity), link.stop_bits)
    plan = Search(likely_lines(named) if settable else (None,))
    opened = False
    while (attempt := plan.attempt) is not None:
        line = attempt.line
        try:
            session = await _Session.opened(
                url if line is None else url_with_line(url, line), clock, on_message
            )
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
    """Open wire on which queries are sent one after another."""

    def __init__(self, wire: Transport[bytes], clock: Clock, on_message: Callable[[str], object]) -> None:
        self._wire = wire
        self._loop = clock.loop
        self._on_message = on_message
        self._prober = Prober()
        self._outcome: asyncio.Future[Outcome] = clock.loop.create_future()
        self._failure: BaseException | None = None
        self._pump: Pump[bytes, ProbeEvent] = Pump(self._prober, wire, clock, self._take, self._ended)
        self._pump.start()

    @classmethod
    async def opened(cls, url: str, clock: Clock, on_message: Callable[[str], object]) -> "_Session":
        return cls(await connect_bytes(url, clock), clock, on_message)

    async def aclose(self) -> None:
        await self._wire.aclose()

    async def ask(self, attempt: Try, patience: float) -> Outcome:
        """Send one query and wait for its outcome. Raises TransportError if the wire ends."""
        if self._failure is not None:
            raise self._failure
        self._outcome = self._loop.create_future()
        self._prober.ask(attempt.query, profile_of(attempt, patience, ANSWER_PATIENCE_S))
        self._pump.kick()
        return await self._outcome

    def _take(self, event: ProbeEvent) -> None:
        match event:
            case UnsolicitedMessage(text):
                self._on_message(text)
            case Outcome() if not self._outcome.done():
                self._outcome.set_result(event)

    def _ended(self, cause: BaseException) -> None:
        self._failure = cause
        with suppress(asyncio.InvalidStateError):
            self._outcome.set_exception(cause)
            self._outcome.exception()  # mark the exception as retrieved, even if the waiting task has ended


def url_with_line(url: str, line: LineSettings) -> str:
    """Return the URL with its line settings replaced by these."""
    head, _, query = url.partition("?")
    options = dict(parse_qsl(query, keep_blank_values=True))
    options |= {"baudrate": str(line.baudrate), "parity": line.parity.value, "stopbits": str(line.stopbits)}
    return f"{head}?{urlencode(options, safe='/', quote_via=quote)}"


def line_text(line: LineSettings | None) -> str:
    """Return the baud rate and the character format in the usual notation."""
    return "line as it is" if line is None else f"{line.baudrate} 8{line.parity.value}{line.stopbits}"


def try_text(attempt: Try) -> str:
    """Return a description of a try."""
    stuffing = "doubled" if attempt.dle_stuffing == "double" else "single"
    query = attempt.query.name.lower()
    return f"{line_text(attempt.line)}, length {attempt.length_style}, 10h {stuffing}, {query} status"


def finding_rows(url: str, finding: Finding) -> list[tuple[str, str]]:
    """Return a finding as a table of two columns."""
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
    """Return the evidence for the profile: the length styles that the controller answered."""
    answered = " and ".join(finding.answered)
    if finding.profile == DEFAULT_PROFILE:
        return f"length {answered} answered"
    return f"length {answered} answered; with this profile a real S3 has been moved"


def site_toml(url: str, finding: Finding) -> str:
    """Return a configuration file with the settings that work, with comments for the user."""
    line, evidence = finding.line, finding.stuffing_evidence
    rows = [
        *FOUND,
        toml_pair("url", f"s3+{url if line is None else url_with_line(url, line)}"),
        "",
        "[robot.s3.link]",
    ]
    rows += [
        f"# {profile_evidence(finding)}; a probe cannot test STX and the length of moves",
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
    """Return the reason why no settings were found, and the remedy."""
    replies = [outcome.reply for _, outcome in log]
    reached = next((attempt for attempt, outcome in log if outcome.reply not in LINE_WRONG), None)
    if reached is not None:
        return Trouble(
            f"{url}: something acknowledges bids at {line_text(reached.line)} but does not accept read status",
            "`hil-bridge monitor` prints the traffic on the line",
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
