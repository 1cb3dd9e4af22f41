"""Page of a conformance test: verdict first, and a time line from the values of a trial."""

import re
import shlex
from dataclasses import replace
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from hil_bridge.cli import cli
from hil_bridge.lab.conform.page import conform_page, repeat_command
from hil_bridge.lab.conform.reports import evidence
from hil_bridge.lab.conform.robots.stage import RobotTrial
from hil_bridge.lab.conform.robots.timeline import robot_timeline
from hil_bridge.lab.conform.verdict import Outcome, Verdict
from hil_bridge.settings.configuration import load_config
from hil_bridge.show.pages.timeline import Interval, Moment, TimeLine, Tone, timeline
from tests.conform.naive import EgmClient, Naive, RsiClient
from tests.conform.test_planted import SHORT, run_scenario
from tests.conform.test_readings import run_scenario as run_sensor_scenario
from tests.conform.test_readings import trial as sensor_trial

COMMAND = ["--", "/opt/lab/my client", "{host}"]
TESTED_AT = datetime(2026, 3, 1, 12, 0, tzinfo=UTC)


def robot_trial(kind: str = "egm") -> RobotTrial:
    return RobotTrial(load_config(None, {"robot.emulated": kind}), "", SHORT, Naive)


def line_of(client: type[Naive], mistake: str, scenario: str) -> TimeLine:
    return robot_timeline(scenario, run_scenario(client, mistake, scenario).seen, SHORT)


def moments(line: TimeLine) -> list[tuple[float, str]]:
    return [(round(one.at, 3) + 0.0, one.text) for one in sorted(line.moments, key=lambda one: one.at)]


def test_timeline_has_stop_orders_and_reaction() -> None:
    line = line_of(EgmClient, "blind", "stopped")
    assert moments(line) == [
        (0.0, "last good order before the stop"),
        (0.0, "the robot stops and reports it"),
        (0.48, "the tool stands, after 2.9 mm"),
        (
            0.504,
            "first motion order after the time to react: pose, a step of 0.04 mm; the robot does not execute it",
        ),
        (1.0, "last of 125 such orders"),
        (1.0, "the client is asked to terminate (SIGTERM)"),
        (1.01, "the client terminates, by SIGTERM"),
    ]
    late = [one for one in line.intervals if one.tone is Tone.BAD]
    assert [(one.lane, round(one.begin, 3), round(one.end, 3)) for one in late] == [
        ("orders of the client", 0.504, 1.0)
    ]


def test_evidence_has_plain_types_only() -> None:
    """The suites pass it to another process."""

    def types(value: Any) -> set[type]:
        parts = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
        return {type(value)}.union(*map(types, parts))

    result = evidence(run_scenario(EgmClient, "blind", "stopped"))
    assert result["offences"]
    assert types(result) <= {dict, list, str, int, float, bool}


def test_timeline_after_cut_has_leap_and_lost_link() -> None:
    texts = {text: at for at, text in moments(line_of(RsiClient, "clock", "cut"))}
    leap = "first order that leaps: relative correction, a step of 33.8 mm; the robot does not execute it"
    assert texts["the link is restored"] == 1.0
    assert texts[leap] == 3.408
    assert texts["the robot stops: KSS29002: object ETHERNET1 returns error RSITimeout"] == 0.41


def test_timeline_names_speed_that_jumps_in_nominal() -> None:
    line = line_of(EgmClient, "metres", "nominal")
    bad = [one.text for one in line.moments if one.tone is Tone.BAD]
    assert line.zero == "the start of the client"
    assert bad == [
        "first order that leaps: pose, a step of 1085 mm; the robot accepts it",
        "the robot stops because of an order: failed: the input is out of bounds",
        "the tool's speed changes by 334 mm/s",
        "the tool is left moving at 0.5 mm/s",
    ]


def test_timeline_of_sensor_has_readings_after_fault() -> None:
    trial = sensor_trial("netft", "blind")
    one = run_sensor_scenario("status", trial)
    texts = [text for _, text in moments(trial.timeline("status", one.seen))]
    assert texts == [
        "first reading",
        "last good reading before the fault",
        "the sensor reports its values as invalid",
        "first of 75 readings after the time to react",
        "the client is asked to terminate (SIGTERM)",
        "the client terminates, by SIGTERM",
    ]


@pytest.mark.parametrize(
    ("begin", "labels"), [(-0.75, ["−0.5", "0", "1", "2 s"]), (-0.05, ["0", "0.5", "1", "1.5", "2 s"])]
)
def test_timeline_axis_has_negative_time_if_there_is_room(begin: float, labels: list[str]) -> None:
    line = TimeLine([Moment(2.0, "end")], [Interval("client", begin, 2.0)], "the stop")
    ticks = re.findall(r'<text class="quiet"[^>]*>(.*?)</text>', timeline(line))
    assert sorted(ticks, key=lambda text: float(text.removesuffix(" s").replace("−", "-"))) == labels


def test_page_begins_with_verdict_and_escapes_client() -> None:
    failed = replace(run_scenario(EgmClient, "blind", "stopped"), output="<b>\x1b[2J\n")
    passed = replace(failed, name="nominal", verdict=Verdict(Outcome.PASSED, "moved"))
    text = conform_page(robot_trial(), [passed, failed], COMMAND, TESTED_AT)
    verdict = (
        "The client failed <code>stopped</code>, 1 of 2 scenarios: sent 125 motion orders after the stop"
    )
    assert (
        text.index(verdict) < text.index('<table class="verdicts">') < text.index('<figure class="timeline">')
    )
    assert text.count('<figure class="timeline">') == 1, "a scenario that passed has none"
    full, short = (
        "&#x27;/opt/lab/my client&#x27; &#x27;{host}&#x27;",
        "&#x27;my client&#x27; &#x27;{host}&#x27;",
    )
    assert f'<code title="{full}">{short}</code>, tested 2026-03-01 12:00:00 UTC' in text
    assert text.count("sent 125 motion orders after the stop") == 2, "in the verdict and in the table"
    assert "&lt;b&gt;\ufffd[2J" in text
    assert re.findall(r'(?:src|href)="([^"]*)"', text) == ["#stopped"]
    assert "default-src 'none'" in text


def test_page_warns_of_busy_computer_and_copies_command() -> None:
    one = run_scenario(EgmClient, "blind", "stopped")
    one.seen.late_s = 0.2
    text = conform_page(robot_trial(), [one], COMMAND, TESTED_AT)
    assert (
        '<p class="bar caution"><b>Caution:</b>this computer was too busy in stopped: hil-bridge was late by'
        in text
    )
    assert '<span class="badge bad">failed, timing uncertain</span>' in text
    assert "</code><button type=" in text
    assert "[data-copy]" in text
    passed = replace(one, name="nominal", verdict=Verdict(Outcome.PASSED, "moved"))
    on_time = run_scenario(EgmClient, "blind", "stopped")
    text = conform_page(robot_trial(), [passed, on_time], COMMAND, TESTED_AT)
    assert '<span class="badge bad">failed</span>' in text, "the failed scenario was not late"
    assert "this computer was too busy in nominal" in text


def test_page_joins_names_of_failed_scenarios() -> None:
    failed = run_scenario(EgmClient, "blind", "stopped")
    text = conform_page(robot_trial(), [replace(failed, name=name) for name in "abc"], COMMAND, TESTED_AT)
    assert (
        "The client failed <code>a</code>, <code>b</code> and <code>c</code>, 3 of 3 scenarios.</p>" in text
    )


def test_page_repeats_scenario_with_same_rules() -> None:
    trial = robot_trial()
    trial = replace(trial, rules=replace(SHORT, comes_back=True))
    words = shlex.split(repeat_command(trial, "cut", ["--listen", "egm+udp://127.0.0.1:7", *COMMAND]))
    assert words[:5] == ["hil-bridge", "conform", "egm", "--only", "cut"]
    assert words[5:] == [
        *("--set", "start_s=6", "--set", "after_s=0.3", "--set", "watch_s=1", "--set", "run_s=3"),
        *("--comes-back", "--listen", "egm+udp://127.0.0.1:7", "--", "/opt/lab/my client", "{host}"),
    ]


def test_numbers_of_close_moments_do_not_overlap() -> None:
    close = [Moment(0.001 * k, f"moment {k}") for k in range(8)]
    text = timeline(TimeLine([*close, Moment(2.0, "<end>")], [Interval("lane", 0.0, 1.0)], "the stop"))
    narrow, wide = text.split('<g class="wide">')
    for part, apart in ((narrow, 9.1), (wide, 3.3)):
        places = [float(place) for place in re.findall(r'<circle cx="([\d.]+)%"', part)]
        assert len(places) == 9
        assert all(after - before >= apart for before, after in pairwise(places))
        assert 4.5 <= places[0] < places[-1] <= 95.5
    assert "&lt;end&gt;" in text
    assert timeline(TimeLine([], [], "the stop")) == ""


def test_conform_writes_page_and_keeps_other_file(tmp_path: Path) -> None:
    place = tmp_path / "verdict.html"
    command = ["conform", "rtde", "--only", "nominal", "--set", "start_s=0.2", "--page", str(place)]
    result = CliRunner().invoke(cli, [*command, "--", "sleep", "9"])
    assert result.exit_code == 4, result.output
    text = place.read_text(encoding="utf-8")
    assert "Failed: never connected: nothing in 0.2\u00a0s.</p>" in text
    assert '<table class="verdicts">' not in text, "one scenario needs no table"
    assert "--set start_s=0.2 -- sleep 9</code>" in text
    with pytest.raises(Exception, match="already exists"):
        CliRunner().invoke(cli, [*command, "--", "sleep", "9"], catch_exceptions=False)
