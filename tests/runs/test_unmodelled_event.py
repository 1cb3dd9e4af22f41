"""A run records the features that its client uses and the emulated device does not model."""

from collections.abc import Callable
from typing import Any

import pytest

import hil_bridge
from emulators.devices.rsi import RsiController
from hil_bridge.record import EventKind
from protocol.unmodelled import NotModelled
from tests.near_surface import SHORT, merged

RSI = merged(SHORT, {"robot": {"emulated": "rsi"}, "sensor": {"emulated": "ft300"}})


def events(result: Any) -> list[Any]:
    return [event for event in result.recording.events if event.kind == EventKind.NOT_MODELLED]


@pytest.mark.full
@pytest.mark.parametrize(
    "sensor", ["netft", "ft300", "ft300-urcap", "ati-can", "jr3", "jr3-uart", "jr3-board"]
)
@pytest.mark.parametrize("robot", ["rsi", "rtde"])
def test_built_in_clients_use_only_modelled_features(robot: str, sensor: str) -> None:
    if robot == "rtde" and sensor != "jr3":
        pytest.skip("each device once is enough")
    devices = {"robot": {"emulated": robot}, "sensor": {"emulated": sensor}}
    assert events(hil_bridge.simulate(merged(SHORT, devices))) == []


def test_unmodelled_feature_is_recorded_with_fields(monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    receive: Callable[..., None] = RsiController.receive

    def with_text(robot: RsiController, data: Any, now: float) -> None:
        """Each answer shows a text on the robot's display, too."""
        receive(robot, [raw.replace(b"<RKorr", b"<EStr>ready</EStr><RKorr") for raw in data], now)

    monkeypatch.setattr(RsiController, "receive", with_text)
    result = hil_bridge.simulate(RSI)
    assert result.outcome == "completed", result.text
    (event,) = events(result)
    thing = NotModelled("rsi", "tag EStr", "read, but its channel is not connected")
    assert event.not_modelled == thing
    assert event.text == str(thing)
    path = tmp_path / "run.mcap"
    result.save(path)
    (read,) = [event for event in hil_bridge.read(path).events if event.kind == EventKind.NOT_MODELLED]
    assert read.not_modelled == thing
