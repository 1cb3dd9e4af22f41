"""Panels of emulated streaming robots: each control acts, is displayed, and can be reset by `hil-bridge panel`."""

import asyncio
import dataclasses
import json
from collections.abc import Awaitable, Callable
from typing import Any

import pytest
from click.testing import CliRunner

from emulators.cell import Cell
from emulators.panel import Panel
from hil_bridge.cli import cli
from hil_bridge.clock import Clock, run_real, run_virtual
from hil_bridge.devices.kinds import ROBOTS
from hil_bridge.errors import ConfigError
from hil_bridge.runs.compose import emulated_cell, make_cell
from hil_bridge.runs.serve import report_hindrances
from hil_bridge.runs.setup import Listen, Setup
from hil_bridge.settings.configuration import read_config

pytestmark = pytest.mark.sweep

T0 = 100.0
STREAMS = [name for name in ROBOTS.own if name != "s3"]


class Bench:
    """Robot in its cell without a client, and its panel."""

    def __init__(self, robot: str) -> None:
        sections = {
            "robot": {"emulated": robot},
            "cell": {"egm": {"silence": "never"}, "rsi": {"timeout": 1000}},
        }
        self.cell: Cell[Any, Any] = make_cell(Setup(read_config(sections)), T0)
        emulation = ROBOTS.kind(robot).emulation
        assert emulation is not None
        assert emulation.controls is not None
        self.panel = Panel(self.cell.robot, emulation.controls, self.cell.ledger)
        self.now = T0

    def wait(self, seconds: float) -> None:
        end = self.now + seconds
        endpoint = self.cell.robot.endpoint
        while (due := endpoint.next_deadline()) is not None and due <= end:
            self.now = max(due, self.now)
            endpoint.handle_deadline(self.now)
            endpoint.data_to_send(self.now)
        self.now = end
        self.cell.robot.path.advance(end)

    def state(self) -> dict[str, Any]:
        return self.do("show")

    def do(self, name: str, to: str | None = None) -> dict[str, Any]:
        answer = self.panel.perform({"do": name} if to is None else {"do": name, "to": to}, self.now)
        self.wait(0.05)
        state: dict[str, Any] = json.loads(json.dumps(self.panel.show(self.now)))["state"]
        assert answer["rows"], "the panel shows text for operators"
        return state


@pytest.mark.parametrize("robot", STREAMS)
def test_manual_and_injected_stop_are_released_separately(robot: str) -> None:
    bench = Bench(robot)
    assert bench.state()["hindrance"] == ""
    bench.panel.perform({"do": "inject", "fault": "emergency-stop"}, bench.now)
    for hand_first in (True, False):
        bench.do("emergency-stop")
        assert is_stopped(bench), "set by both sides"
        bench.do(*(("emergency-stop", "release") if hand_first else ("mend",)))
        assert is_stopped(bench), "set by the other side"
        if hand_first:
            bench.do("emergency-stop", "press")
    bench.do("emergency-stop", "release")
    assert not is_stopped(bench)
    for control, to in BACK[robot]:
        assert bench.state()["hindrance"], "released, but still stopped"
        bench.do(control, to)
        bench.wait(30.0 if robot == "rtde" else 0.0)
    assert bench.state()["hindrance"] == ""


BACK = {
    "egm": (("motors", "on"), ("program", "start")),
    "rsi": (("drives", "on"), ("program", "start")),
    "rtde": (("power", "on"), ("brakes", "release")),
}
"""Steps of an operator after the release of an emergency stop."""


def is_stopped(bench: Bench) -> bool:
    """Return whether the emergency stop is active, as shown by the panel."""
    state = bench.state()
    stopped = "emergency-stop" in state.get("stops", ()) or state.get("safety") == "robot emergency stop"
    by_fault = state["hindrance"] == "the motion is stopped, telegrams continue"
    return stopped or bool(state.get("emergency_stop")) or by_fault


@pytest.mark.full
def test_rtde_panel_recovers_from_emergency_stop_in_steps() -> None:
    bench = Bench("rtde")
    bench.do("emergency-stop")
    for control, to in (("power", "on"), ("brakes", "release")):
        with pytest.raises(ValueError, match=f"refuses {control} {to}"):
            bench.do(control, to)
    assert bench.do("emergency-stop", "release")["hindrance"] == "robot mode POWER_OFF"
    bench.do("power", "on")
    bench.wait(30.0)
    bench.do("brakes")
    bench.wait(30.0)
    assert bench.state()["hindrance"] == ""


def test_rtde_panel_controls_act_or_are_refused() -> None:
    bench = Bench("rtde")
    assert bench.do("speed", "40")["speed_percent"] == 40.0
    assert bench.do("speed", "12.5")["speed_percent"] == 12.5
    assert bench.do("control", "local")["control"] == "local"
    assert bench.do("control", "remote")["control"] == "remote"
    assert bench.do("safeguard", "open")["safety"] == "safeguard stop"
    assert bench.do("safeguard", "close")["safety"] == "normal"
    with pytest.raises(ValueError, match=r"^there is no protective stop$"):
        bench.do("protective-stop", "unlock")
    bench.cell.ledger.inject("robot", "protective-stop", bench.now, {})
    with pytest.raises(
        ValueError, match=r"^the controller refuses to unlock a protective stop earlier than 5 s after it$"
    ):
        bench.do("protective-stop", "unlock")
    bench.wait(10.0)
    assert bench.do("protective-stop")["safety"] == "normal"
    assert bench.do("power", "off")["mode"] == "power off"
    with pytest.raises(ValueError, match="refuses program pause"):
        bench.do("program", "pause")
    wrong: object
    for wrong in ("fast", "101", "-1", "nan", "", None, True, [], "1e999"):
        with pytest.raises(ValueError, match=r"^speed goes to a number of 0 … 100 %, not "):
            bench.panel.perform({"do": "speed", "to": wrong}, bench.now)


def test_egm_panel_controls_act() -> None:
    bench = Bench("egm")
    bench.wait(1.0)
    assert bench.do("motors", "off")["motors"] == "off"
    assert bench.do("motors", "off")["stops"] == ["program-stopped", "motors-off"], "pressing is idempotent"
    assert bench.do("motors", "on")["stops"] == ["program-stopped"]
    assert bench.do("program", "start")["stops"] == []
    assert bench.do("program", "restart")["rapid"] == "running"
    assert bench.do("program", "stop")["rapid"] == "stopped"
    assert bench.do("program", "start")["rapid"] == "running"


def test_rsi_panel_commands_change_program_state() -> None:
    bench = Bench("rsi")
    bench.wait(0.1)
    assert bench.do("program", "end")["program"] == "CREATED"
    assert bench.state()["hindrance"] == "RSI is off"
    assert bench.do("program", "reset")["program"] in ("ON", "MOVECORR", "ERROR")


@pytest.mark.parametrize("robot", STREAMS)
def test_panel_show_changes_nothing(robot: str) -> None:
    watched, unseen = Bench(robot), Bench(robot)
    for _ in range(50):
        watched.wait(0.0071)
        watched.state()
        unseen.wait(0.0071)
        unseen.wait(0.05)
    assert watched.state() == unseen.state()


@pytest.mark.parametrize("robot", STREAMS)
def test_panel_fault_of_robot_needs_no_target(robot: str) -> None:
    bench = Bench(robot)
    bench.panel.perform({"do": "inject", "fault": "emergency-stop"}, bench.now)
    assert bench.state()["lasting"] == ["robot: emergency-stop"]
    bench.panel.perform({"do": "inject", "target": "wire", "fault": "lost", "with": {"count": 3}}, bench.now)
    assert bench.state()["armed"].keys() == {"wire: lost"}
    assert bench.do("disarm")["armed"] == {}
    assert bench.do("mend")["lasting"] == []
    assert bench.panel.perform({"do": "faults"}, bench.now)["faults"].keys() >= {
        "robot",
        "pose",
        "wire",
        "surface",
    }
    controls = bench.panel.perform({"do": "controls"}, bench.now)["controls"]
    assert controls["emergency-stop"]["to"] == ("press", "release")


def on_a_cell(robot: str, use: Callable[[str], Awaitable[None]]) -> None:
    """Run `use` with the panel's URL of a served cell."""
    config = read_config({"robot": {"emulated": robot}})

    async def main() -> None:
        clock = Clock.running()
        listen = Listen("", None, "tcp-listen://127.0.0.1:0")
        try:
            async with emulated_cell(
                Setup(config, listen), clock, lambda cause: pytest.fail(repr(cause))
            ) as served:
                assert served.panel is not None
                await use(served.panel)
        finally:
            clock.close()

    run_real(main)


@pytest.mark.parametrize("robot", STREAMS)
def test_panel_command_reaches_each_robot(robot: str) -> None:
    async def use(url: str) -> None:
        async def do(*arguments: str) -> str:
            result = await asyncio.to_thread(CliRunner().invoke, cli, ["panel", url, *arguments])
            assert result.exception is None, result.exception
            return result.output

        state = await do()
        assert "motion        possible" in state
        assert "lasting       none" in state
        pressed = await do("emergency-stop")
        assert "motion        not possible: " in pressed
        await do("emergency-stop", "release")
        assert "emergency-stop" in await do("faults")
        with pytest.raises(ConfigError, match=r"unknown action 'dance'; known: show, emergency-stop, "):
            await asyncio.to_thread(cli.main, ["panel", url, "dance"], standalone_mode=False)

    on_a_cell(robot, use)


@pytest.mark.parametrize("options", [("--panel", "tcp-listen://127.0.0.1:0"), ("--web",)])
def test_panel_of_robot_without_one_is_refused(
    monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...]
) -> None:
    emulation = ROBOTS.kind("egm").emulation
    assert emulation is not None
    monkeypatch.setattr(
        "hil_bridge.runs.compose._emulation", lambda kind: dataclasses.replace(emulation, controls=None)
    )
    with pytest.raises(ConfigError, match=r"^an emulated egm has no panel; leave .* out$"):
        cli.main(["emulate", "robot", "--robot", "egm", *options], standalone_mode=False)


@pytest.mark.parametrize("robot", ROBOTS.own)
def test_panel_reports_valid_positions_of_controls(robot: str) -> None:
    bench = Bench(robot)
    answer = json.loads(json.dumps(bench.panel.perform({"do": "controls"}, bench.now)))["controls"]
    at = bench.panel.show(bench.now)["at"]
    assert at.keys() >= {"emergency-stop"}
    for name, position in at.items():
        control = answer[name]
        if "unit" in control:
            assert control["least"] <= position <= control["greatest"]
        else:
            assert position in control["to"], name
    for name in ("emergency-stop", *(name for name, one in answer.items() if "auto" in one["to"])):
        for to in answer[name]["to"]:
            bench.panel.perform({"do": name, "to": to}, bench.now)
            assert bench.panel.show(bench.now)["at"][name] == to


def test_panel_help_lists_controls_with_robots() -> None:
    text = " ".join(CliRunner().invoke(cli, ["panel", "--help"]).output.split())
    assert "emergency-stop press|release" in text
    assert "[egm, rsi, rtde, s3]" in text
    assert CliRunner().invoke(cli, ["panel", "tcp://127.0.0.1:1", "--quick"]).exit_code == 2


def test_served_robot_reports_each_reason_not_to_move() -> None:
    """A controller that waits for its client times out repeatedly, which is reported once."""
    logged: list[str] = []

    async def main() -> None:
        clock = Clock.running()
        config = read_config({"robot": {"emulated": "rsi"}})
        async with emulated_cell(
            Setup(config, Listen("", None)), clock, lambda cause: pytest.fail(repr(cause))
        ) as served:
            reports = asyncio.create_task(report_hindrances(served, clock, logged.append))
            await asyncio.sleep(20.0)
            served.cell.inject("robot", "emergency-stop", clock.now())
            await asyncio.sleep(1.0)
            reports.cancel()

    run_virtual(main)
    assert logged == [
        "robot: KSS29002: object ETHERNET1 returns error RSITimeout",
        "robot: the motion is stopped, telegrams continue",
    ]
