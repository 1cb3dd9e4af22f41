"""The harness of a run: what it closes, and that a close that fails keeps no other from its turn."""

from collections.abc import Callable

import pytest

from hil_bridge.clock import Clock, run_virtual
from hil_bridge.record import TruthRecord
from hil_bridge.runs.faults.schedule import FaultSchedule
from hil_bridge.runs.run_log import RunLog
from hil_bridge.runs.running import running
from hil_bridge.runs.setup import Setup
from hil_bridge.runs.truth import GroundTruth
from hil_bridge.runs.watching import Listener
from hil_bridge.settings.configuration import read_config


def test_a_close_that_raises_keeps_no_other_from_its_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    closed: list[str] = []

    def failing(name: str) -> Callable[[object], None]:
        def close(part: object) -> None:
            closed.append(name)
            raise AssertionError(name)

        return close

    monkeypatch.setattr(FaultSchedule, "close", failing("faults"))
    monkeypatch.setattr(GroundTruth, "close", failing("truth"))

    async def main() -> None:
        listener = Listener({TruthRecord: lambda record: None})
        async with running(Setup(read_config({})), RunLog(Clock.running(), [listener])):
            closed.append("body")

    with pytest.raises(AssertionError, match="truth"):
        run_virtual(main)
    assert closed == ["body", "faults", "truth"]
