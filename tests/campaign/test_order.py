"""Runs in a drawn order of callbacks: bugs that depend on the order are noticed, and the callbacks that changed
places are named.
"""

import asyncio
from collections.abc import Callable
from typing import Any

import pytest
from msgspec.structs import replace as changed

import hil_bridge
from hil_bridge.devices.sensors.stream import ForceSensor
from hil_bridge.lab.campaign.judging import run
from hil_bridge.lab.campaign.orders import fewest_deviations
from hil_bridge.record import CycleRecord
from hil_bridge.record.kept import KeptRecords
from hil_bridge.runs.sampling import Sampler
from protocol.wrench import WrenchFrame

CELL: dict[str, Any] = {
    "run": {"duration_s": 0.2},
    "task": {"retract_mm": 1.0, "safe_height_mm": 0.5},
    "cell": {"start_position_mm": [900.0, -100.0, 590.5]},
}
STREAMED: dict[str, Any] = {**CELL, "robot": {"emulated": "egm"}, "sensor": {"emulated": "ati-can"}}


def drawn(cell: dict[str, Any], shuffled: str, seed: int) -> hil_bridge.Config:
    return hil_bridge.load({**cell, "virtual": {"shuffled": shuffled, "seed": seed}})


def after_race(lost: Callable[[], object], won: Callable[[], object]) -> None:
    """Call `won` if two callbacks that become ready together run in the order of their requests, else `lost`."""
    first_ran: list[bool] = []

    def first() -> None:
        first_ran.append(True)

    def second() -> None:
        (won if first_ran else lost)()

    loop = asyncio.get_running_loop()
    loop.call_soon(first)
    loop.call_soon(second)


def in_loop(patch: pytest.MonkeyPatch) -> None:
    """A sample whose force depends on which of two callbacks of the cycle before ran first."""
    take, bias = Sampler.take, [0.0]

    def biased(self: Sampler, *given: Any) -> Any:
        after_race(lambda: bias.__setitem__(0, 1.0), lambda: bias.__setitem__(0, 0.0))
        sample = take(self, *given)
        return changed(sample, force=sample.force + bias[0])

    patch.setattr(Sampler, "take", biased)


def in_client(patch: pytest.MonkeyPatch) -> None:
    """A client that loses a frame if its reader is late."""
    take = ForceSensor._take

    def racing(self: Any, event: Any) -> None:
        if isinstance(event, WrenchFrame):
            after_race(lambda: None, lambda: take(self, event))
        else:
            take(self, event)

    patch.setattr(ForceSensor, "_take", racing)


def in_recorder(patch: pytest.MonkeyPatch) -> None:
    """A recorder that writes another value if its writer is late."""
    put = KeptRecords.put

    def racing(self: KeptRecords, record: Any) -> None:
        if isinstance(record, CycleRecord):
            after_race(lambda: put(self, changed(record, held=True)), lambda: put(self, record))
        else:
            put(self, record)

    patch.setattr(KeptRecords, "put", racing)


@pytest.mark.parametrize("shuffled", ["timers", "all"])
def test_run_decides_the_same_in_any_order(shuffled: str) -> None:
    figures = run(drawn(STREAMED, shuffled, 5)).figures
    assert figures["outcome"] == "completed"
    assert figures["promises_broken"] == 0


@pytest.mark.parametrize("plant", [in_loop, in_client, in_recorder])
def test_bug_of_order_is_noticed_and_named(
    plant: Callable[[pytest.MonkeyPatch], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    config = drawn(CELL, "all", 1)
    assert fewest_deviations(config) == ()
    plant(monkeypatch)
    promises = run(config).figures["promises"]
    assert isinstance(promises, dict)
    assert "another order of callbacks that are due together changes" in str(promises["order-equal"])
    deviations = fewest_deviations(config)
    assert 1 <= len(deviations) <= 6
    assert all(".second before " in str(deviation) for deviation in deviations)
    begun = hil_bridge.simulate(CELL).cycles[0].started_at
    assert all(deviation.at >= begun for deviation in deviations), "connecting keeps the usual order"
