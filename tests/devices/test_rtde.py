"""Robot over RTDE in a complete run, and the force source, in virtual time."""

import asyncio
import json
from collections.abc import Callable
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from emulators.devices.rtde import RtdeRobot
from emulators.seams import StartPose
from hil_bridge.cli import cli
from hil_bridge.clock import Clock, run_virtual
from hil_bridge.device_commands.rtde.force_source import ForceOptions, ForceSource, feed, make_surface
from hil_bridge.devices.device_log import NullLog
from hil_bridge.devices.kinds import ROBOTS
from hil_bridge.devices.robots.rtde import port_server as ports
from hil_bridge.devices.robots.rtde.addresses import parse_address
from hil_bridge.devices.robots.seam import MotionLimits
from hil_bridge.devices.wiring import Serving, Wiring
from hil_bridge.errors import BridgeError, ConfigError, DeviceError
from hil_bridge.record import read
from hil_bridge.settings.configuration import Config, read_config
from hil_bridge.settings.kinds import settings_of
from protocol.devices.rtde import packets
from protocol.devices.rtde.force import ForceClient, Lost, Seen
from protocol.devices.rtde.packets import Kind
from protocol.devices.rtde.states import Runtime
from protocol.devices.rtde.wires import Piece, Port
from protocol.geometry import Pose
from tests.emulation.exact_arm import EXACT
from tests.near_surface import AWAKE_TOML

pytestmark = pytest.mark.sweep

RUN = """
[robot]
emulated = 'rtde'
[run]
period_ms = {period}
[controller]
sample_ms = {period}
[task]
retract_mm = 2.0
retract_speed_mm_s = 20.0
approach_depth_limit_mm = 20.0
[limits]
retract_patience_s = 0.5
"""
START = StartPose((0.9, -0.1, 0.6), (0.0, 1.0, 0.0, 0.0), 0.2)


class Runs:
    """Runs of the command, each with its exit code, output and files."""

    def __init__(self, folder: Path) -> None:
        self.place = folder
        self.number = 0

    def __call__(self, more: str = "", duration: float = 2.0, period: float = 20.0) -> tuple[int, str, Path]:
        self.number += 1
        config, record = self.place / "c.toml", self.place / f"{self.number}.mcap"
        near = "" if "[cell]" in more else f"{AWAKE_TOML}cell.start_position_mm = [900.0, -100.0, 590.5]\n"
        config.write_text(near + RUN.format(period=period) + more)
        arguments = ["run", str(config), "--virtual", "--no-view", "--seed", "7", "--duration", str(duration)]
        files = ["--record", str(record), "--summary", str(record.with_suffix(".json"))]
        try:
            result = CliRunner().invoke(cli, [*arguments, *files], catch_exceptions=False)
        except BridgeError as error:
            return error.exit_code, str(error), record
        return result.exit_code, result.output, record


@pytest.fixture
def runs(tmp_path: Path) -> Runs:
    return Runs(tmp_path)


def summary_of(record: Path) -> dict[str, Any]:
    result: dict[str, Any] = json.loads(record.with_suffix(".json").read_text())
    return result


@pytest.mark.full
def test_rtde_run_holds_force_and_is_reproducible(runs: Runs) -> None:
    code, output, first = runs()
    assert code == 0, output
    summary = summary_of(first)
    assert summary["outcome"] == "completed"
    assert summary["force_mean_steady_n"] == pytest.approx(10.0, abs=0.5)
    assert summary["link"]["answers"] == summary["link"]["packets"] > 1000
    assert "left: retracted" in output
    _, _, second = runs()
    assert first.read_bytes() == second.read_bytes()
    replayed = CliRunner().invoke(cli, ["replay", str(first)], catch_exceptions=False)
    assert (replayed.exit_code, "every command identical" in replayed.output) == (0, True)
    assert "robot's packet" in CliRunner().invoke(cli, ["latency", str(first)]).output
    cycles = read(first).cycles
    assert max(cycle.cycle for cycle in cycles) > 100


@pytest.mark.full
def test_rtde_run_holds_force_along_contour(runs: Runs) -> None:
    surface = (
        "[frame]\nfollow_normal = true\n[cell]\njr3.gateway.boot_s = 0.2\n"
        "start_position_mm = [900, -100, 591]\n[cell.surface]\nkind = 'sinusoidal'\n"
        "amplitude_mm = 5.0\nperiod_mm = 200.0\n"
    )
    code, output, record = runs(surface, duration=4.0)
    assert code == 0, output
    # The joints lag their targets by up to 0.1 mrad: 0.1 mm of this tool, and 0.5 N of this surface.
    assert summary_of(record)["force_mean_steady_n"] == pytest.approx(10.0, abs=1.0)
    assert "contact losses 0" in output


def test_rtde_run_with_cb3_cycle_holds_force(runs: Runs) -> None:
    cb3 = "[robot.rtde]\ncycle_ms = 8\n[cell.rtde]\ncycle_ms = 8\nmodel = 'ur10'\nversion = '3.15.0.0'\n"
    code, output, record = runs(cb3, duration=2.0, period=24.0)
    assert code == 0, output
    assert summary_of(record)["force_mean_steady_n"] == pytest.approx(10.0, abs=0.5)


@pytest.mark.parametrize(
    ("on", "fault", "message"),
    [
        ("robot", "protective-stop", "protective stop"),
        ("robot", "emergency-stop", "emergency stop"),
        ("robot", "program-stopped", "our program is stopped"),
        ("wire", "dropped", "the peer closed"),
        ("wire", "mute", "nothing received for 100 ms"),
        ("pose", "nan", "(nan, nan, nan)"),
    ],
)
def test_rtde_refusal_ends_run_with_one_line(runs: Runs, on: str, fault: str, message: str) -> None:
    code, output, _ = runs(f"[[faults]]\non = '{on}'\nfault = '{fault}'\nwhen = 'force > 8'\n", duration=1.0)
    assert code == 3
    assert message in output
    assert "left: NOT retracted" in output


@pytest.mark.parametrize(
    ("more", "code", "message"),
    [
        ("[cell.rtde]\nremote_control = false\n", 3, "it is in local control; switch it to Remote Control"),
        ("[[faults]]\non = 'robot'\nfault = 'in-use'\n", 3, "another client holds its input registers"),
        ("[cell.rtde]\nmodel = 'ur5e'\n", 2, "a ur5e cannot hold its tool at the start"),
        ("[cell.rtde]\ncycle_ms = 8\n", 2, "set both to 2 for an e-Series, to 8 for a CB3"),
        ("[cell.rtde]\nversion = 'five'\n", 2, "version must be four numbers with dots"),
        ("[cell.rtde]\nversion = '3.15.0.0'\n", 2, "must be 5.0.0.0 or later for model ur10e"),
    ],
)
def test_rtde_run_that_cannot_begin_reports_reason(runs: Runs, more: str, code: int, message: str) -> None:
    result, output, _ = runs(more, duration=0.5)
    assert message in output
    assert result == code


# --- addresses


def test_rtde_url_defines_all_ports() -> None:
    address = parse_address("tcp://127.0.0.1:41000?dashboard=41001&script=41002")
    assert dict(address.ports) == {Port.RTDE: 41000, Port.DASHBOARD: 41001, Port.SCRIPT: 41002}
    assert parse_address("tcp://10.0.0.5").wire.host_port == ("10.0.0.5", 30004)
    memory = parse_address("memory:ur?latency_ms=1")
    assert memory.memory_url(Port.DASHBOARD) == "memory:ur-dashboard?latency_ms=1"
    kind = ROBOTS.kind("rtde")
    assert kind.parse("tcp://10.0.0.5", settings_of(Config(), kind)).host_port == ("10.0.0.5", 30004)


@pytest.mark.parametrize(
    "url",
    [
        "udp://10.0.0.5",
        "tcp://",
        "tcp://h:x",
        "tcp://h?port=3",
        "tcp://h?script=99999",
        "tcp://h/path",
        "memory:",
    ],
)
def test_rtde_invalid_url_is_refused_in_one_line(url: str) -> None:
    with pytest.raises(ConfigError) as refused:
        parse_address(url)
    assert "\n" not in str(refused.value)


# --- the force source

CONFIG = read_config({"robot": {"emulated": "rtde"}})


async def with_robot(act: Callable[[RtdeRobot, Clock, Callable[[], Wiring]], Any]) -> Any:
    """Call a function with an emulated robot in memory."""
    clock = Clock.running()
    robot = RtdeRobot(EXACT, START, clock.now(), 7)
    async with AsyncExitStack() as stack:
        failures: list[BaseException] = []
        serving = Serving(clock, stack, failures.append, lambda text: None)
        await ports.serve("memory:ur", robot, serving)
        result = await act(robot, clock, lambda: Wiring("robot", clock, NullLog()))
        assert not failures
    return result


@pytest.mark.parametrize("mass", [0.0, 0.5])
def test_force_source_sets_force_of_controller(mass: float) -> None:
    async def act(robot: RtdeRobot, clock: Clock, wiring: Callable[[], Wiring]) -> float:
        robot.controller.force.carry(mass, (0.03, 0.0, 0.05))
        stopped = asyncio.Event()
        source = asyncio.create_task(feed("rtde+memory:ur", CONFIG, ForceOptions(), wiring(), stopped))
        await clock.sleep_until(clock.now() + 0.3)
        assert robot.controller.force.external
        kind = ROBOTS.kind("rtde")
        link = await kind.connect("memory:ur", settings_of(CONFIG, kind), wiring())
        link.start()
        report = await link.ready()
        (x, y, _), quaternion = report.pose
        async with link.motion(MotionLimits(0.05)) as motion:
            await motion.to(Pose((x, y, 0.588), quaternion))
            await motion.settled()
        await clock.sleep_until(clock.now() + 0.5)
        force = robot.controller.snapshots[0].force
        assert force[2] == pytest.approx(10.0, abs=0.1)
        moment = 0.2 * force[0]
        assert force[4] == pytest.approx(-moment, abs=0.05)
        await link.aclose()
        stopped.set()
        result = await source
        await clock.sleep_until(clock.now() + 0.01)
        robot.controller.advance(clock.now())
        assert robot.controller.snapshots[0].force == pytest.approx((0.0,) * 6, abs=1e-9), (
            "the force is removed"
        )
        assert robot.controller.player.runtime == Runtime.STOPPED
        return float(result.largest_n)

    assert run_virtual(lambda: with_robot(act)) == pytest.approx(10.0, abs=1.0)


def test_force_source_second_instance_is_refused() -> None:
    async def act(robot: RtdeRobot, clock: Clock, wiring: Callable[[], Wiring]) -> None:
        stopped = asyncio.Event()
        first = asyncio.create_task(feed("rtde+memory:ur", CONFIG, ForceOptions(), wiring(), stopped))
        await clock.sleep_until(clock.now() + 0.1)
        with pytest.raises(DeviceError, match="another client holds external_force_torque"):
            await feed("rtde+memory:ur", CONFIG, ForceOptions(), wiring(), asyncio.Event())
        stopped.set()
        await first

    run_virtual(lambda: with_robot(act))


def test_force_source_stops_at_excessive_force() -> None:
    deep = read_config({"cell": {"surface": {"height_mm": 650.0}}})

    async def act(robot: RtdeRobot, clock: Clock, wiring: Callable[[], Wiring]) -> None:
        with pytest.raises(DeviceError, match="the surface force is 250 N; allowed: at most 200 N"):
            await feed("rtde+memory:ur", deep, ForceOptions(), wiring(), asyncio.Event())

    run_virtual(lambda: with_robot(act))


def test_force_source_stops_when_clock_goes_back() -> None:
    source = ForceSource(make_surface(CONFIG), 200.0)
    pose = Pose((0.9, 0.0, 0.6), (0.0, 1.0, 0.0, 0.0))
    tip = Pose((0.0, 0.0, 0.2), (1.0, 0.0, 0.0, 0.0))
    assert source.wrench(Seen(100.0, pose, (0.0, 0.0, 0.0), tip)) == (0.0,) * 6
    with pytest.raises(DeviceError, match="clock went back"):
        source.wrench(Seen(99.0, pose, (0.0, 0.0, 0.0), tip))


def test_force_source_refuses_other_kinds_of_robot() -> None:
    with pytest.raises(ConfigError, match="a s3 accepts no external force"):
        CliRunner().invoke(
            cli, ["emulate", "force-source", "s3+tcp://127.0.0.1:4000"], catch_exceptions=False
        )


@pytest.mark.parametrize(
    ("packet", "message"),
    [
        (packets.accepted(Kind.VERSION, False), "refuses to speak version 2"),
        (packets.HEADER.pack(1, Kind.DATA), "does not speak RTDE"),
    ],
)
def test_force_client_reports_errors_as_text(packet: bytes, message: str) -> None:
    client = ForceClient(500.0, True, 0.0)
    client.receive((Piece(Port.RTDE, packet),), 0.1)
    event = client.next_event()
    assert isinstance(event, Lost)
    assert message in event.text
    assert client.next_deadline() is None
