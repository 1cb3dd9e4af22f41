"""The search for a robot's link settings: every combination on emulated controllers, in virtual time."""

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest

from hil_bridge.clock import Clock, run_virtual
from hil_bridge.device_commands.s3.probe import (
    find_trouble,
    finding_rows,
    probe,
    profile_evidence,
    site_toml,
    try_text,
    url_with_line,
)
from hil_bridge.device_commands.s3.prober import Prober, UnsolicitedMessage, profile_of
from hil_bridge.device_commands.s3.search import Finding, Outcome, Query, Reply, Search, Try, likely_lines
from hil_bridge.devices.robots.s3.room import ROBOT as S3
from hil_bridge.errors import ConfigError, TransportUnavailable
from hil_bridge.record import Outcome as RunOutcome
from hil_bridge.runs.checks import problems
from hil_bridge.runs.compose import emulated_cell
from hil_bridge.runs.result import RunResult
from hil_bridge.runs.run_log import RunLog
from hil_bridge.runs.running import running
from hil_bridge.runs.setup import Listen, Setup
from hil_bridge.settings.configuration import Config, load_config
from hil_bridge.settings.kinds import settings_of
from hil_bridge.transports import LineSettings, Parity, Tap, listen_bytes
from hil_bridge.transports.pump import Pump
from protocol.devices.s3.adlp import Control, DleStuffing, LengthStyle, LinkProfile, encode_block
from tests.paper_cell import PaperCell, PaperCellProfile, s3_jr3_cell

EIGHT = [
    (parity, stuffing, style)
    for parity in (Parity.EVEN, Parity.NONE)
    for stuffing in ("off", "double")
    for style in ("whole", "data")
]


@dataclass
class ProbeResult:
    """Findings and output of a probe."""

    finding: Finding | None = None
    attempts: list[tuple[Try, Outcome]] = field(default_factory=list)
    said: list[str] = field(default_factory=list)
    sent: bytes = b""
    took: float = 0.0
    cell: PaperCell | None = None


def probe_controller(
    link: LinkProfile,
    url: str = "memory:robot",
    listen: str | None = None,
    position_mm: tuple[float, float, float] = (900.0, -100.0, 600.0),
    prepare: Callable[[PaperCell, float], object] = lambda cell, now: None,
) -> ProbeResult:
    """Probe an emulated controller with these settings."""
    result = ProbeResult()

    async def main() -> None:
        clock = Clock.running()
        result.cell = cell = s3_jr3_cell(
            replace(PaperCellProfile(), link=link, start_position_mm=position_mm), clock.now(), 1
        )
        listening = await listen_bytes(
            listen or f"memory:robot?baudrate={link.baudrate}&parity={link.parity}", clock
        )

        def record_traffic(direction: object, data: bytes) -> None:
            if direction == "rx":
                result.sent += data

        pump: Pump[bytes, Any] = Pump(
            cell.robot,
            Tap(listening.transport, record_traffic),
            clock,
            lambda event: None,
            lambda cause: None,
        )
        pump.start()
        begun = clock.now()
        prepare(cell, begun)
        pump.kick()
        result.finding = await probe(
            url,
            clock,
            0.7,
            lambda attempt, outcome: result.attempts.append((attempt, outcome)),
            result.said.append,
        )
        result.took = clock.now() - begun
        await listening.transport.aclose()

    run_virtual(main)
    return result


@pytest.mark.parametrize(("parity", "stuffing", "style"), EIGHT)
def test_probe_finds_each_combination_of_settings(parity, stuffing, style, tmp_path: Path) -> None:
    link = LinkProfile(parity=parity.value, dle_stuffing=stuffing, accepted_lengths=style)
    result = probe_controller(link)
    finding = result.finding
    assert finding is not None
    assert (finding.line, finding.dle_stuffing, finding.length_style) == (
        LineSettings(9600, parity),
        stuffing,
        style,
    )
    assert finding.stuffing_evidence
    assert result.took < 4.0
    file = tmp_path / "site.toml"
    file.write_text(site_toml("memory:robot", finding))
    config = load_config(file, {})
    link = settings_of(config, S3).client.link
    assert (link.parity, link.dle_stuffing, link.length_style) == (parity, stuffing, style)
    assert f"parity={parity.value}" in config.robot.url


@pytest.mark.parametrize(
    ("accepted", "stuffing", "profile", "style"),
    [
        ("both", "off", "observed-client", "data"),
        ("data", "off", "observed-client", "data"),
        ("whole", "off", "default", "whole"),
        ("both", "double", "default", "whole"),
        ("data", "double", "default", "data"),
    ],
)
def test_probe_writes_profile_that_answers(accepted, stuffing, profile, style, tmp_path: Path) -> None:
    finding = probe_controller(LinkProfile(accepted_lengths=accepted, dle_stuffing=stuffing)).finding
    assert finding is not None
    assert (finding.profile, finding.length_style) == (profile, style)
    note = "" if profile == "default" else "; with this profile a real S3 has been moved"
    lengths = "whole and data" if accepted == "both" else accepted
    assert profile_evidence(finding) == f"length {lengths} answered{note}"
    assert ("profile", f"{profile} ({profile_evidence(finding)})") in finding_rows("memory:robot", finding)
    file = tmp_path / "site.toml"
    file.write_text(site_toml("memory:robot", finding))
    link = settings_of(load_config(file, {}), S3).client.link
    assert link == LinkProfile.named(profile, dle_stuffing=stuffing, length_style=style)
    assert link.move_length == (60 if profile == "observed-client" else 52)


def test_probe_output_runs_after_completion(tmp_path: Path) -> None:
    """The controller needs settings other than the defaults; time is virtual."""
    link = LinkProfile(parity="N", dle_stuffing="double", accepted_lengths="data")
    finding = probe_controller(link).finding
    assert finding is not None
    file = tmp_path / "site.toml"
    file.write_text(site_toml("memory:robot", finding))
    assert [name for name, _ in problems(Setup(load_config(file, {})), virtual=False)] == ["wires"]
    assert load_config(file, {"sensor.url": "jr3+can+memory:sensor"}).tool == Config().tool
    file.write_text(file.read_text().replace("#= ", "").replace("can+socketcan://can0", "can+memory:sensor"))
    config = load_config(file, {"run.duration_s": 1.0})
    assert config.task == Config().task, "the hints are the defaults"
    assert config.limits == Config().limits
    assert config.frame == Config().frame
    assert list(problems(Setup(config), virtual=False)) == []

    async def main() -> RunResult:
        clock = Clock.running()
        listen = f"s3+memory:robot?baudrate={link.baudrate}&parity={link.parity}"
        cell: Any = config.cell
        own = replace(settings_of(config, S3).emulated, link=link)
        async with (
            emulated_cell(
                Setup(
                    config.model_copy(update={"cell": replace(cell, s3=own)}),
                    Listen(listen, "jr3+can+memory:sensor"),
                ),
                clock,
                lambda cause: pytest.fail(repr(cause)),
            ),
            running(Setup(config), RunLog(clock, [])) as run,
        ):
            return await run()

    result = run_virtual(main)
    assert (result.outcome, result.left) == (RunOutcome.COMPLETED, "retracted, 0.0 N (Fx Fy not verified)")


@pytest.mark.parametrize("line", [LineSettings(19200, Parity.NONE), LineSettings(300, Parity.EVEN)])
def test_probe_finds_other_baud_rates(line: LineSettings) -> None:
    result = probe_controller(LinkProfile(baudrate=line.baudrate, parity=line.parity.value))
    assert result.finding is not None
    assert result.finding.line == line
    assert result.took < 25.0


def test_probe_finds_odd_parity() -> None:
    """ENQ and ACK contain two ones each: with odd parity, their parity bit looks like a stop bit."""
    result = probe_controller(LinkProfile(parity="O"), url="memory:robot?baudrate=9600&parity=N")
    assert result.attempts[0][1].reply is Reply.BLOCK_REFUSED
    assert result.finding is not None
    assert result.finding.line == LineSettings(9600, Parity.ODD)


def test_probe_sends_read_status_only() -> None:
    result = probe_controller(LinkProfile(dle_stuffing="double", accepted_lengths="data"))
    left = result.sent
    styles: tuple[LengthStyle, ...] = "whole", "data"
    stuffings: tuple[DleStuffing, ...] = "off", "double"
    blocks = {
        encode_block(query.value.encode(style), stuffing)
        for query, style, stuffing in itertools.product(Query, styles, stuffings)
    }
    for block in sorted(blocks, key=len, reverse=True):
        left = left.replace(block, b"")
    assert set(left) <= {Control.ENQ, Control.ACK, Control.EOT}
    assert {query.value.function for query in Query} == {19}


def test_probe_tries_settings_of_url_first() -> None:
    result = probe_controller(
        LinkProfile(baudrate=4800, parity="N"), url="memory:robot?baudrate=4800&parity=N"
    )
    assert [attempt.line for attempt, _ in result.attempts] == [LineSettings(4800)] * 3


def test_probe_answer_with_dle_decides_doubling() -> None:
    """X = 898 mm is 1C10h."""
    for stuffing in ("off", "double"):
        result = probe_controller(LinkProfile(dle_stuffing=stuffing), position_mm=(898.0, -100.0, 600.0))
        assert result.finding is not None
        assert result.finding.dle_stuffing == stuffing
        assert result.finding.stuffing_evidence.startswith("an answer with 10h")
        assert Query.MARKED not in [attempt.query for attempt, _ in result.attempts]


def test_probe_acknowledges_and_reports_messages() -> None:
    """The controller bids before the probe listens, and answers no bid until it has bid again."""
    result = probe_controller(LinkProfile(), prepare=lambda cell, now: cell.robot.press_emergency_stop(now))
    assert result.finding is not None
    assert len(result.said) == 1
    assert "operational error" in result.said[0]
    assert "emergency stop" in result.attempts[0][1].text


def test_probe_wire_without_listener_fails_at_once() -> None:
    with pytest.raises(TransportUnavailable, match="no program listens"):
        probe_controller(LinkProfile(), url="memory:other")
    with pytest.raises(ConfigError, match="unknown scheme"):
        probe_controller(LinkProfile(), url="serail:///dev/ttyUSB0")


# --- the plan without any wire


USUAL = LineSettings(9600, Parity.EVEN)


def run_search(answer: Callable[[Try], Outcome], lines=(USUAL,)) -> tuple[Search, list[Try]]:
    search, attempts = Search(lines), []
    while search.attempt is not None:
        attempts.append(search.attempt)
        search.take(answer(search.attempt))
    return search, attempts


def test_probe_without_marked_queries_leaves_doubling_open() -> None:
    search, attempts = run_search(
        lambda attempt: Outcome(Reply.ANSWERED if attempt.query is Query.PLAIN else Reply.BLOCK_REFUSED)
    )
    assert search.finding == Finding(USUAL, ("whole", "data"), "off", "")
    assert len(attempts) == 4
    assert "# not decided" in site_toml("serial:///dev/ttyUSB0", search.finding)


def test_probe_of_silent_link_tries_every_line_once() -> None:
    lines = likely_lines(USUAL)
    search, attempts = run_search(lambda attempt: Outcome(Reply.SILENCE), lines)
    assert search.finding is None
    assert [attempt.line for attempt in attempts] == list(lines)
    assert lines[:4] == (
        LineSettings(9600, Parity.EVEN),
        LineSettings(9600),
        LineSettings(19200, Parity.EVEN),
        LineSettings(19200),
    )
    assert len(set(lines)) == len(lines) == 21


def test_probe_of_wire_without_line_uses_it_unchanged() -> None:
    search, _ = run_search(lambda attempt: Outcome(Reply.ANSWERED, holds_dle=True), (None,))
    assert search.finding is not None
    text = site_toml("tcp://10.0.0.5:4000", search.finding)
    assert 'url = "s3+tcp://10.0.0.5:4000"' in text
    assert "baudrate" not in text


@pytest.mark.parametrize(
    ("replies", "message"),
    [
        ([Reply.SILENCE], "crossed"),
        ([Reply.SILENCE, Reply.NOISE], "only noise"),
        ([Reply.BID_REFUSED], "TO SC"),
        ([Reply.SILENCE, Reply.BLOCK_REFUSED], "acknowledges bids at 9600 8E1"),
    ],
)
def test_probe_failures_report_remedy(replies, message) -> None:
    attempt = Try(LineSettings(9600, Parity.EVEN), "whole", "off", Query.PLAIN)
    log = [(attempt, Outcome(reply)) for reply in replies]
    assert message in str(find_trouble("serial:///dev/ttyS0", log))


def test_probe_url_keeps_other_options() -> None:
    assert (
        url_with_line("serial:///dev/ttyS0", USUAL) == "serial:///dev/ttyS0?baudrate=9600&parity=E&stopbits=1"
    )
    url = url_with_line("memory:robot?latency_ms=5&parity=E&baudrate=300", LineSettings(9600))
    assert url == "memory:robot?latency_ms=5&parity=N&baudrate=9600&stopbits=1"
    assert (
        try_text(Try(None, "data", "double", Query.MARKED))
        == "line as it is, length data, 10h doubled, marked status"
    )


def test_prober_reports_messages_and_outcome() -> None:
    """Unsolicited 127 suffix 17, data 5, 3; then no answer to the bid."""
    prober = Prober()
    prober.receive(b"\x05", 0.0)
    assert prober.data_to_send(0.0) == b"\x06"
    prober.receive(encode_block(bytes.fromhex("000C00007F03001100050003")), 0.1)
    prober.receive(b"\x04", 0.2)
    assert isinstance(message := prober.next_event(), UnsolicitedMessage)
    assert "5.3" in message.text
    attempt = Try(LineSettings(), "whole", "off", Query.PLAIN)
    prober.ask(attempt.query, profile_of(attempt, 0.5, 1.0))
    assert prober.data_to_send(1.0) == b"\x05"
    deadline = prober.next_deadline()
    assert deadline is not None
    assert deadline == pytest.approx(1.5, abs=0.01)
    prober.handle_deadline(deadline)
    assert prober.next_event() == Outcome(Reply.SILENCE)
    assert prober.next_event() is None
