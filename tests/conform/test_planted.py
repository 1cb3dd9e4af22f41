"""Planted mistakes of clients, judged with the rules as they are by default. In virtual time."""

import asyncio
from pathlib import Path

import pytest

from hil_bridge.clock import run_virtual
from hil_bridge.lab.conform.robots.scenarios import Rules
from hil_bridge.lab.conform.robots.stage import RobotTrial
from hil_bridge.lab.conform.robots.watching import RobotEvidence
from hil_bridge.lab.conform.trial import ScenarioResult, play
from hil_bridge.lab.conform.verdict import Outcome
from hil_bridge.runs.compose import choose_port
from hil_bridge.settings.configuration import load_config
from hil_bridge.settings.devices import robot_at
from tests.conform.naive import (
    PLANTED,
    EgmClient,
    Naive,
    OwnServoClient,
    Planted,
    RsiClient,
    RtdeClient,
    S3Client,
    ScriptClient,
)

pytestmark = pytest.mark.sweep

PAGE = Path(__file__).parents[2] / "docs/reference/conform.md"
SHORT = Rules(run_s=3.0, start_s=6.0, watch_s=1.0, after_s=0.3)
"""The default rules, with shorter times."""


def played(client: type[Naive], mistake: str, scenario: str) -> ScenarioResult[RobotEvidence]:
    async def main() -> ScenarioResult[RobotEvidence]:
        config = load_config(None, {"robot.emulated": client.kind})
        url = choose_port(robot_at(config, ""), virtual=True).named_url
        one = await play(scenario, RobotTrial(config, url, SHORT, lambda: client(mistake)))
        await asyncio.sleep(0.5)  # a task that was told to end does so
        return one

    return run_virtual(main)


class CallingClient(RtdeClient):
    """Sends a definition and a line that calls it."""

    program = RtdeClient.program + b"hil_bridge()\n"


STREAMING = (EgmClient, RsiClient, RtdeClient, ScriptClient, OwnServoClient, CallingClient)
USUAL = ("nominal", "late", "stopped", "cut")
GOOD = [
    *[(client, scenario) for client in STREAMING for scenario in USUAL],
    (S3Client, "nominal"),
]


@pytest.mark.parametrize(("client", "scenario"), GOOD)
def test_without_a_mistake_they_pass(client: type[Naive], scenario: str) -> None:
    one = played(client, "", scenario)
    assert one.verdict.outcome is Outcome.PASSED, one.verdict.reason


@pytest.mark.parametrize(
    "planted", PLANTED, ids=lambda each: f"{each.client.__name__}-{each.mistake.replace(' ', '-')}"
)
def test_a_planted_mistake_is_found_or_known_not_to_be(planted: Planted) -> None:
    one = played(planted.client, planted.mistake, planted.scenario)
    outcome = Outcome.FAILED if planted.reason else Outcome.PASSED
    assert one.verdict.outcome is outcome, one.verdict.reason
    assert planted.reason in one.verdict.reason


def test_page_has_count_of_planted_mistakes() -> None:
    count = sum(bool(each.reason) for each in PLANTED)
    assert f"{count} of {len(PLANTED)} planted mistakes are found" in PAGE.read_text(encoding="utf-8")
