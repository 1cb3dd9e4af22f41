"""Output of the sensor probe, with emulated sensors in virtual time and simulated pushes."""

import asyncio
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from emulators.devices.jr3 import Gateway, SensorProfile
from hil_bridge.clock import VIRTUAL_EPOCH, Clock, run_virtual
from hil_bridge.errors import DeviceError
from hil_bridge.runs.compose import emulated_cell, make_cell
from hil_bridge.runs.setup import Listen, Setup
from hil_bridge.runs.zeroing import wrist
from hil_bridge.settings.configuration import read_config
from hil_bridge.site.sensor_probe import Screen, Session, probe
from tests.paper_cell import PaperCell

pytestmark = pytest.mark.sweep

Force = Callable[[float], Sequence[float]]
"""Force of a hand on the tool at a time since the start, s; tool frame, N."""
URLS = {
    "gateway": "jr3+can+memory:sensor",
    "uart": "jr3-uart+memory:sensor",
    "board": "jr3-board+memory:sensor",
}


def probe_sensor(
    before: str = "gateway",
    hand: Force | None = None,
    enter_at: Sequence[float] = (),
    prepare: Callable[[PaperCell], object] = lambda cell: None,
    duration_s: float = 2.0,
    mounting: dict[str, Any] | None = None,
    output: list[str] | None = None,
    **sections: Any,
) -> list[str]:
    """Return the lines of a probe; those of the live wrench begin with ~. `mounting` is the true mounting of the
    sensor.
    """
    config = read_config(sections)
    wrist_mounting = wrist(read_config({"sensor": mounting or {}}))
    lines = [] if output is None else output

    def laid_on(*arguments: Any) -> PaperCell:
        cell = make_cell(*arguments)
        prepare(cell)
        if hand is None:
            return cell
        own = cell.wrench

        def wrench(times: NDArray[np.float64]) -> NDArray[np.float64]:
            wrenches = own(times)
            moments, places = np.unique(np.floor((times - VIRTUAL_EPOCH) * 100.0), return_inverse=True)
            forces = np.array([hand(moment / 100.0) for moment in moments.tolist()]).reshape(-1, 3)
            wrenches[:, :3] += (forces @ wrist_mounting.alignment())[places]
            return wrenches

        cell.wrench = wrench  # type: ignore[method-assign]
        return cell

    async def main() -> None:
        clock = Clock.running()
        listen = Listen(None, URLS[before])
        monkeypatch = pytest.MonkeyPatch()
        monkeypatch.setattr("hil_bridge.runs.compose.make_cell", laid_on)
        async with emulated_cell(Setup(config, listen), clock, lambda cause: pytest.fail(repr(cause))):
            monkeypatch.undo()
            entered = asyncio.Event()
            for at in enter_at:
                clock.call_at(VIRTUAL_EPOCH + at, entered.set)
            screen = Screen(lines.append, lambda text: lines.append(f"~{text}"))
            session = Session(screen, None if hand is None else entered, duration_s)
            await probe(URLS[before], config, clock, session)

    run_virtual(main)
    return lines


def row(lines: list[str], name: str) -> str:
    (result,) = [line for line in lines if line.startswith(f"{name} ")]
    return result.removeprefix(name).strip()


@pytest.mark.parametrize("before", ["gateway", "uart", "board"])
def test_sensor_probe_shows_description_and_wrench(before: str) -> None:
    lines = probe_sensor(before, cell={"tool": {"mass_kg": 2.0}})
    scales = SensorProfile().full_scales_n
    assert f"Fx {scales[0]:.0f}  Fy {scales[1]:.0f}  Fz {scales[2]:.0f} N" in row(lines, "full scales")
    assert row(lines, "filter delay").endswith(" ms")
    assert row(lines, "stream").startswith("99 frames")
    assert "rms over 1 s" in row(lines, "noise")
    wrench = row(lines, "wrench")
    live = [line for line in lines if line.startswith("~")]
    assert len(live) == 2
    assert abs(abs(float(live[-1].split("Fz ")[1].split()[0])) - 2.0 * 9.80665) < 0.5
    assert abs(abs(float(wrench.split("Fz ")[1].split()[0])) - 2.0 * 9.80665) < 0.5
    assert any("sensor model" in line for line in lines) is (before == "board")


def test_sensor_probe_noise_is_rms_of_each_axis() -> None:
    """The noise is reported after the filter: twice the noise at the converter is reported as twice the noise."""
    reported = [
        float(
            row(probe_sensor(cell={"jr3": {"sensor": {"noise_counts": counts}}}), "noise")
            .split("Fz ")[1]
            .split()[0]
        )
        for counts in (20.0, 200.0)
    ]
    assert reported[1] / reported[0] == pytest.approx(10.0, rel=0.25)


def pushes_in_turn(
    *forces: Sequence[float], begin: float = 8.0, every: float = 8.0, hold: float = 3.0
) -> Force:
    """Return pushes one after the other."""

    def hand(at: float) -> Sequence[float]:
        number, into = divmod(at - begin, every)
        return forces[int(number)] if 0 <= number < len(forces) and into < hold else (0.0, 0.0, 0.0)

    return hand


X, Y, Z = (20.0, 0.0, 0.0), (0.0, 20.0, 0.0), (0.0, 0.0, 20.0)


def test_pushes_confirm_configured_mounting() -> None:
    lines = probe_sensor(hand=pushes_in_turn(X, Y, Z))
    answers = [line.strip() for line in lines if line.startswith("  +")]
    assert [answer[:7] for answer in answers] == ["+X: +Fx", "+Y: +Fy", "+Z: +Fz"]
    assert all(answer.endswith("as configured") for answer in answers)
    assert not any("[sensor]" in line for line in lines)


@pytest.mark.parametrize(
    ("wrist_mounting", "answers", "settings"),
    [
        ({"flip_fx_mx": True}, ["−Fx", "+Fy", "+Fz"], ("flip_fx_mx = true", "mounting_deg = 0.0")),
        ({"mounting_deg": 90.0}, ["−Fy", "+Fx", "+Fz"], ("flip_fx_mx = false", "mounting_deg = 90.0")),
        (
            {"quaternion": (0.0, 1.0, 0.0, 0.0)},
            ["+Fx", "−Fy", "−Fz"],
            ("flip_fx_mx = false", "quaternion = [0.0, 1.0, 0.0, 0.0]"),
        ),
    ],
)
def test_pushes_suggest_settings_for_other_mounting(
    wrist_mounting: dict[str, Any], answers: list[str], settings: tuple[str, ...]
) -> None:
    lines = probe_sensor(hand=pushes_in_turn(X, Y, Z), mounting=wrist_mounting)
    assert [line.strip()[4:7] for line in lines if line.startswith("  +")] == answers
    assert any("off the mounting in [sensor] of the configuration" in line for line in lines)
    assert all(f"  {setting}" in lines for setting in settings)
    right = probe_sensor(hand=pushes_in_turn(X, Y, Z), mounting=wrist_mounting, sensor=wrist_mounting)
    assert sum(line.endswith("as configured") for line in right) == 3


def test_enter_skips_push_and_knock_is_ignored() -> None:
    def hand(at: float) -> Sequence[float]:
        return (0.0, 0.0, 50.0) if 5.0 < at < 5.1 else Y if 10.0 < at < 13.0 else (0.0, 0.0, 0.0)

    lines = probe_sensor(hand=hand, enter_at=(8.0, 20.0))
    answers = [line for line in lines if line.startswith("  +")]
    assert (answers[0], answers[1][:9], answers[2]) == ("  +X: skipped", "  +Y: +Fy", "  +Z: skipped")


def test_push_in_wrong_direction_requests_all_three() -> None:
    lines = probe_sensor(hand=pushes_in_turn((0.0, 0.0, -20.0), Y, Z))
    assert any(line.startswith("  +X: −Fz responds") and "90° off" in line for line in lines)
    assert any("a clear push along all three axes" in line for line in lines)


@pytest.mark.full
def test_missing_push_times_out() -> None:
    lines = probe_sensor(hand=lambda at: (0.0, 0.0, 0.0))
    assert [line for line in lines if line.startswith("  +")] == [f"  +{name}: skipped" for name in "XYZ"]


def test_sensor_probe_sends_only_start_requests() -> None:
    """Without a zero, the load of the sensor and its offsets remain."""
    wrenches = [
        line
        for line in probe_sensor(cell={"tool": {"mass_kg": 3.0}}, hand=pushes_in_turn(X, Y, Z))
        if line[0] == "~"
    ]
    assert abs(abs(float(wrenches[-1].split("Fz ")[1].split()[0])) - 3.0 * 9.80665) < 0.5


def test_sensor_probe_without_sensor_is_one_line() -> None:
    lines: list[str] = []
    with pytest.raises(DeviceError, match="sensor unplugged"):
        probe_sensor(cell={"jr3": {"sensor": {"connected": False}}}, output=lines)
    assert not any("sensor unplugged" in line for line in lines), "only the error reports it"


def test_silent_sensor_ends_the_probe() -> None:
    def unplug(cell: PaperCell) -> None:
        gateway = cell.sensor
        assert isinstance(gateway, Gateway)
        own = gateway.data_to_send
        gateway.data_to_send = lambda now: () if now > VIRTUAL_EPOCH + 6.0 else own(now)  # type: ignore[method-assign]

    with pytest.raises(DeviceError, match="0 frames in the last 1 s: it does not stream"):
        probe_sensor(prepare=unplug, duration_s=60.0)
