"""Sensor clients in every scenario, in virtual time: ours passes, one with a planted mistake does not."""

import asyncio

import pytest

from hil_bridge.clock import run_virtual
from hil_bridge.errors import ConfigError
from hil_bridge.lab.conform.sensors.readings import Lines, Part, SensorEvidence
from hil_bridge.lab.conform.sensors.scenarios import SENSOR_SCENARIOS, SensorRules
from hil_bridge.lab.conform.sensors.stage import SensorTrial
from hil_bridge.lab.conform.trial import ScenarioResult, choose_scenarios, play
from hil_bridge.lab.conform.verdict import Outcome
from hil_bridge.runs.compose import choose_port
from hil_bridge.settings.configuration import load_config
from hil_bridge.settings.devices import sensor_at
from tests.conform.reading_clients import PLANTED_READINGS, PlantedReading, Reader

pytestmark = pytest.mark.sweep

KINDS = ("netft", "ft300", "ati-can", "jr3", "jr3-uart")


def trial(kind: str, mistake: str = "", **rules: bool) -> SensorTrial:
    config = load_config(None, {"sensor.emulated": kind})
    url = choose_port(sensor_at(config, ""), virtual=True).named_url
    return SensorTrial(config, url, SensorRules(**rules), lambda: Reader(kind, mistake))


def run_scenario(scenario: str, of: SensorTrial) -> ScenarioResult[SensorEvidence]:
    async def main() -> ScenarioResult[SensorEvidence]:
        one = await play(scenario, of)
        await asyncio.sleep(1.0)  # lets cancelled tasks end
        return one

    return run_virtual(main)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("scenario", [*SENSOR_SCENARIOS])
def test_own_sensor_client_passes(kind: str, scenario: str) -> None:
    of = trial(kind)
    if scenario not in of.scenarios:
        pytest.skip("this sensor cannot have it")
    one = run_scenario(scenario, of)
    assert one.verdict.outcome is Outcome.PASSED, one.verdict.reason
    assert one.seen.readings > 10


def test_client_declaring_zero_under_load_passes() -> None:
    one = run_scenario("nominal", trial("netft", "zero", takes_zero=True))
    assert one.verdict.outcome is Outcome.PASSED, one.verdict.reason
    assert one.seen.truth is not None
    assert one.seen.truth[2] == pytest.approx(4.9, abs=0.1)
    assert one.seen.at_rest == pytest.approx((0.0,) * 6, abs=0.15)


@pytest.mark.parametrize(
    "planted", PLANTED_READINGS, ids=lambda each: f"{each.kind}-{each.words.replace(' ', '-')}"
)
def test_planted_sensor_mistake_is_detected(planted: PlantedReading) -> None:
    one = run_scenario(
        planted.scenario, trial(planted.kind, planted.mistake, takes_zero=planted.declares_zero)
    )
    assert one.verdict.outcome is Outcome.FAILED, one.verdict.reason
    assert planted.reason in one.verdict.reason


def test_client_that_does_not_recover_fails() -> None:
    one = run_scenario("cut", trial("netft", comes_back=True))
    assert one.verdict.outcome is Outcome.FAILED
    assert "did not reconnect within 10 s, as declared" in one.verdict.reason


def test_silent_client_fails_and_other_scenarios_skip() -> None:
    class Mute(Reader):
        def _publish(self, wrench: list[float]) -> None:
            assert self.on_output is not None
            self.on_output(b"1 2 3\nfx fy fz mx my mz\n")

    of = SensorTrial(
        trial("netft").config, trial("netft").port, SensorRules(start_s=8.0), lambda: Mute("netft")
    )
    nominal = run_scenario("nominal", of)
    assert nominal.verdict.reason == "reported no reading: nothing in 8 s"
    skipped = of.refuse("cut", nominal)
    assert skipped is not None
    assert skipped.verdict.outcome is Outcome.SKIPPED


def test_scenarios_match_sensor_capabilities() -> None:
    assert [*trial("ft300").scenarios] == ["nominal", "lost", "cut", "restart"]
    assert [*trial("jr3").scenarios] == ["nominal", "lost", "status", "cut"]
    with pytest.raises(
        ConfigError, match="no scenario 'status' for ft300; known: nominal, lost, cut, restart"
    ):
        choose_scenarios(trial("ft300"), ["status"])


def test_lines_are_parsed_with_any_split() -> None:
    text = b"1 2 3 4 5 6\nlog: 1 2 3 4 5 6\n7,8;9\t10 11,12\r\nnan 0 0 0 0 0\n1 2 3 4 5 6 7\n" + b"x" * 9000
    for size in (1, 7, 1000):
        lines = Lines()
        for begin in range(0, len(text), size):
            lines.take(text[begin : begin + size], 1.0)
        lines.take(b" 1 2\n1 1 1 1 1 1\n", 2.0)
        assert [one.wrench for one in lines.readings] == [
            (1, 2, 3, 4, 5, 6),
            (7, 8, 9, 10, 11, 12),
            (1, 1, 1, 1, 1, 1),
        ]
        assert lines.no_numbers == 1
        assert len(lines.during(Part(1.5, 2.5))) == 1
