"""Planted mistakes of clients, judged by the default rules in virtual time."""

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
"""Default rules with shorter times."""


def run_scenario(client: type[Naive], mistake: str, scenario: str) -> ScenarioResult[RobotEvidence]:
    async def main() -> ScenarioResult[RobotEvidence]:
        config = load_config(None, {"robot.emulated": client.kind})
        url = choose_port(robot_at(config, ""), virtual=True).named_url
        one = await play(scenario, RobotTrial(config, url, SHORT, lambda: client(mistake)))
        await asyncio.sleep(0.5)  # lets cancelled tasks end
        return one

    return run_virtual(main)


class CallingClient(RtdeClient):
    """Client that sends a definition and a line that calls it."""

    program = RtdeClient.program + b"hil_bridge()\n"


STREAMING = (EgmClient, RsiClient, RtdeClient, ScriptClient, OwnServoClient, CallingClient)
USUAL = ("nominal", "late", "stopped", "cut")
GOOD = [
    *[(client, scenario) for client in STREAMING for scenario in USUAL],
    (S3Client, "nominal"),
]


@pytest.mark.parametrize(("client", "scenario"), GOOD)
def test_clients_without_mistake_pass(client: type[Naive], scenario: str) -> None:
    one = run_scenario(client, "", scenario)
    assert one.verdict.outcome is Outcome.PASSED, one.verdict.reason


@pytest.mark.parametrize(
    "planted", PLANTED, ids=lambda each: f"{each.client.__name__}-{each.mistake.replace(' ', '-')}"
)
def test_planted_mistake_is_detected_or_listed_as_missed(planted: Planted) -> None:
    one = run_scenario(planted.client, planted.mistake, planted.scenario)
    outcome = Outcome.FAILED if planted.reason else Outcome.PASSED
    assert one.verdict.outcome is outcome, one.verdict.reason
    assert planted.reason in one.verdict.reason


def test_page_states_count_of_planted_mistakes() -> None:
    count = sum(bool(each.reason) for each in PLANTED)
    assert f"{count} of {len(PLANTED)} planted mistakes" in PAGE.read_text(encoding="utf-8")
