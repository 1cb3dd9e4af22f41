"""Loss of a sensor during a run, for each of the three devices in front of it."""

from collections.abc import Callable
from typing import Any

import pytest

from hil_bridge.clock import Clock, run_virtual
from hil_bridge.record import CycleRecord, Outcome
from hil_bridge.runs.compose import make_cell
from hil_bridge.runs.result import RunResult
from hil_bridge.runs.run_log import RunLog
from hil_bridge.runs.running import running
from hil_bridge.runs.setup import Listen, Setup
from hil_bridge.runs.watchers import Listener
from hil_bridge.settings.configuration import Config

URLS = {
    "CAN gateway": "jr3+can+memory:sensor",
    "UART gateway": "jr3-uart+memory:sensor",
    "receiver board": "jr3-board+memory:sensor",
}


class Silenced:
    """Device that stops responding once it is silenced."""

    def __init__(self, endpoint: Any) -> None:
        self._endpoint = endpoint
        self.endpoint, self.handlers = self, endpoint.handlers
        self.silent = False

    def receive(self, data: Any, now: float) -> None:
        if not self.silent:
            self._endpoint.receive(data, now)

    def next_event(self) -> Any:
        return self._endpoint.next_event()

    def data_to_send(self, now: float) -> Any:
        data = self._endpoint.data_to_send(now)
        return data[:0] if self.silent else data

    def next_deadline(self) -> float | None:
        return None if self.silent else self._endpoint.next_deadline()

    def handle_deadline(self, now: float) -> None:
        self._endpoint.handle_deadline(now)


def run_until_lost(url: str, lose: Callable[[Any, float], None]) -> tuple[RunResult, float]:
    """A run whose sensor is lost in its tenth cycle of tracking; its end, and what presses then in N."""
    kept: list[Any] = []

    async def main() -> None:
        clock, config, tracked = Clock.running(), Config(), list[CycleRecord]()
        setup = Setup(config, Listen("s3+memory:robot", url))
        cell = make_cell(setup, clock.now())
        if lose is silence:
            cell.sensor = Silenced(cell.sensor)

        def cycle(record: CycleRecord) -> None:
            if record.phase == "track":
                tracked.append(record)
                if len(tracked) == 10:
                    lose(cell, clock.now())

        async with running(setup, RunLog(clock, [Listener({CycleRecord: cycle})]), cell) as run:
            kept.append(await run())
            kept.append(cell.true_state(clock.now()).contact_force[2])

    run_virtual(main)
    result, force = kept
    return result, force


def silence(cell: Any, now: float) -> None:
    cell.sensor.silent = True


def unplug(cell: Any, now: float) -> None:
    cell.sensor.unplug(now)


@pytest.mark.parametrize("device", ["CAN gateway", "UART gateway"])
def test_sensor_unplugged_from_gateway_retracts(device: str) -> None:
    """Its frames continue with the counter and the values of the last sample."""
    result, force = run_until_lost(URLS[device], unplug)
    assert result.outcome is Outcome.STOPPED
    assert "the newest force is" in result.text
    assert "frames arrive, but their counter does not change, as after the sensor is unplugged" in result.text
    assert "\n" not in result.text
    assert force == 0.0


@pytest.mark.parametrize("device", ["CAN gateway", "UART gateway"])
def test_silent_gateway_retracts(device: str) -> None:
    result, force = run_until_lost(URLS[device], silence)
    assert result.outcome is Outcome.STOPPED
    assert "the newest force is" in result.text
    assert "\n" not in result.text
    assert force == 0.0


def test_sensor_unplugged_from_board_retracts() -> None:
    result, force = run_until_lost(URLS["receiver board"], unplug)
    assert result.outcome is Outcome.STOPPED
    assert "watch dog" in result.text
    assert "\n" not in result.text
    assert force == 0.0
