"""`identify tool`: the robot turns the tool of the emulated cell, and the load below the sensor is identified."""

import itertools
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import hil_bridge.cli
from hil_bridge.control import rotation_matrix
from hil_bridge.devices.robots.s3.motion import S3Motion
from hil_bridge.devices.robots.seam import Sent
from hil_bridge.devices.sensors.stream import ForceSensor
from hil_bridge.errors import BridgeError
from hil_bridge.record import Outcome
from hil_bridge.settings.configuration import load_config
from hil_bridge.site.tool.measuring import Sweep, measure
from protocol.geometry import Pose, angle_between

pytestmark = pytest.mark.sweep

MASS_TOLERANCE_KG = 0.002
CENTRE_TOLERANCE_MM = 0.3
"""Far above the effect of half a count of the default sensor: 0.7 g and 0.1 mm."""
START = (0.9, -0.1, 0.6)

Command = Callable[..., tuple[int, str, str]]


@pytest.fixture
def identify(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], tmp_path: Path) -> Command:
    """Run `hil-bridge identify tool` in an empty folder; `config` is the text of its configuration."""
    monkeypatch.chdir(tmp_path)

    def command(*arguments: str, config: str = "") -> tuple[int, str, str]:
        Path("c.toml").write_text(config)
        monkeypatch.setattr(sys, "argv", ["hil-bridge", "identify", "tool", "c.toml", *arguments])
        with pytest.raises(SystemExit) as ended:
            hil_bridge.cli.main()
        output, errors = capfd.readouterr()
        return int(ended.value.code or 0), output, errors

    return command


def refusal(result: tuple[int, str, str], code: int = 2) -> str:
    """Return the last line of the error output; progress may precede it."""
    assert result[0] == code, result
    line = result[2].splitlines()[-1]
    assert line.startswith("hil-bridge: ")
    return line


def test_identify_tool_finds_default_tool(identify: Command) -> None:
    code, output, _ = identify("--virtual", "-o", "tool.toml")
    assert code == 0
    assert "6 poses, up to 60° apart" in output
    result = load_config(Path("tool.toml"), {})
    assert result.tool.mass_kg == pytest.approx(0.5, abs=MASS_TOLERANCE_KG)
    assert result.tool.centre_of_gravity_mm == pytest.approx((0.0, 0.0, 80.0), abs=CENTRE_TOLERANCE_MM)
    # A zero during the motion would appear here as tool weight.
    assert result.sensor.bias_n == pytest.approx((0.0, 0.0, 0.0), abs=0.01)
    assert result.sensor.bias_nm == pytest.approx((0.0, 0.0, 0.0), abs=0.001)


def test_identify_tool_from_table_finds_other_tool(identify: Command) -> None:
    cell = "[cell.tool]\nmass_kg = 1.2\ncentre_of_gravity_mm = [15.0, -10.0, 60.0]\n"
    code, measured, _ = identify("--virtual", "--save", "poses.csv", "-o", "tool.toml", config=cell)
    assert code == 0
    result = load_config(Path("tool.toml"), {}).tool
    assert result.mass_kg == pytest.approx(1.2, abs=MASS_TOLERANCE_KG)
    assert result.centre_of_gravity_mm == pytest.approx((15.0, -10.0, 60.0), abs=CENTRE_TOLERANCE_MM)

    code, computed, errors = identify("--from", "poses.csv", "-o", "again.toml")
    assert (code, errors) == (0, "")
    assert Path("again.toml").read_text() == Path("tool.toml").read_text()
    assert computed.splitlines()[:-1] == measured.splitlines()[1:-1]

    code, _, errors = identify("--from", "poses.csv", config="[sensor]\nmounting_deg = 10.0")
    assert code == 0
    assert errors.startswith("the residuals are large")


def test_identify_tool_turns_in_small_steps_and_returns(
    identify: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    ordered: list[tuple[tuple[float, ...], tuple[float, ...]]] = []
    order = S3Motion.to

    async def noted(motion: S3Motion, target: Pose) -> Sent:
        ordered.append(target)
        return await order(motion, target)

    async def never(sensor: ForceSensor) -> None:
        pytest.fail("a zero was taken")

    monkeypatch.setattr(S3Motion, "to", noted)
    monkeypatch.setattr(ForceSensor, "tare", never)
    assert identify("--virtual", "--angle-deg", "20", "--lift-mm", "30")[0] == 0
    heights = [position[2] for position, _ in ordered]
    assert min(heights) >= START[2]
    assert max(heights) == pytest.approx(START[2] + 0.030)
    assert ordered[-1][0] == pytest.approx(START)
    tilts = [math.degrees(angle_between((0.0, 1.0, 0.0, 0.0), turned)) for _, turned in ordered]
    assert max(tilts) == pytest.approx(20.0)
    assert tilts[-1] == pytest.approx(0.0, abs=0.01)
    for (before, old), (after, new) in itertools.pairwise(ordered):
        assert math.dist(before, after) <= 1.2e-3
        assert math.degrees(angle_between(old, new)) <= 2.001
        if rotation_matrix(new)[2, 2] > -0.9999:
            assert after[2] == pytest.approx(START[2] + 0.030)


def test_identify_tool_enforces_limits(identify: Command) -> None:
    stopped = refusal(identify("--virtual", config="[limits]\nresultant_limit_n = 1.0"), 3)
    assert "stopped: resultant force 1." in stopped
    assert "beyond 1 N; free the tool" in stopped
    low = refusal(identify("--virtual", config="[limits]\nworkspace_max_m = [3.0, 3.0, 0.63]"))
    assert "the tool cannot be lifted by 50 mm (--lift-mm): 0.900 -0.100 0.650 m is outside the box" in low


def test_identify_tool_unreachable_angle_is_refused(identify: Command) -> None:
    text = refusal(identify("--virtual", "--angle-deg", "90"))
    assert "the tool cannot be turned by 90° (--angle-deg): the emulated arm cannot reach that far" in text
    text = refusal(identify("--virtual", "--robot", "rsi", "--angle-deg", "25"))
    assert "the robot's client turns it by less than 20°; raise that limit of [robot.rsi]" in text
    text = refusal(identify("--virtual", "--robot", "rsi", config="[robot.rsi]\nlimit_deg = 10.0"))
    assert "the tool cannot be turned by 15° (--angle-deg)" in text


def test_identify_tool_ends_when_robot_refuses() -> None:
    """The reach of a real arm is not known in advance."""
    reported: list[str] = []
    with pytest.raises(BridgeError) as refused:
        measure(load_config(None, {}), True, Sweep(90.0), reported.append)
    assert "outside" in str(refused.value) or "area" in str(refused.value)
    assert reported[-1].startswith(
        "left: where it stopped, up to 50 mm above its start and turned by up to 90°"
    )


@pytest.mark.full
@pytest.mark.parametrize(
    ("robot", "sensor", "turned"),
    [("rtde", "jr3-board", 30), ("rsi", "jr3", 38), ("s3", "netft", 60)],
)
def test_identify_tool_uses_largest_reachable_angle(
    identify: Command, robot: str, sensor: str, turned: int
) -> None:
    """A stream brings many packets between two frames of a slow sensor, and reports its position with noise."""
    code, output, errors = identify(
        *("--virtual", "--robot", robot, "--sensor", sensor, "-o", "tool.toml"),
        *("--settle-s", "0.3", "--average-s", "0.3"),
    )
    assert code == 0, errors
    assert f"6 poses, up to {turned}° apart" in output
    assert ("as far as the robot can" in errors) == (turned < 60)
    result = load_config(Path("tool.toml"), {}).tool
    assert result.mass_kg == pytest.approx(0.5, abs=0.01), (
        "0.1 N, of which 0.07 N are the vibration of an arm"
    )
    assert result.centre_of_gravity_mm == pytest.approx((0.0, 0.0, 80.0), abs=1.0)


def test_identify_tool_stop_names_remedy_of_its_cause(identify: Command) -> None:
    """After a stop for an outdated force, the remedy is not to free the tool."""
    text = refusal(identify("--virtual", config="[limits]\nstale_after_ms = 0.5"), 3)
    assert "stopped: the newest force is " in text
    assert "free the tool" not in text


def test_identify_tool_too_small_angle_is_refused(identify: Command) -> None:
    assert "14.9 is not in the range 15.0<=x<=90.0" in refusal(identify("--virtual", "--angle-deg", "14.9"))
    assert identify("--virtual", "--angle-deg", "15")[0] == 0


HEAD = "qw,qx,qy,qz,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm"


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (None, "cannot read poses.csv: No such file"),
        ("a,b\n1,2\n", "poses.csv: missing column qw; the first line must name the columns"),
        (f"{HEAD}\n0,1,0,0,1,2,x,4,5,6\n", "poses.csv, line 2: fz_n must be a number, got 'x'"),
        (f"{HEAD}\n0,1,0,0,1,2\n", "line 2: fz_n must be a number, got None"),
        (f"{HEAD}\n0,1,0,0,1,2,nan,4,5,6\n", "line 2: fz_n must be finite"),
        (f"{HEAD}\n0,0,0,0,1,2,3,4,5,6\n", "line 2: qw, qx, qy, qz are not a rotation"),
        (f"{HEAD}\n0,1,0,0,1,2,3,4,5,6\n", "too few poses to identify the tool: 1 of at least 3"),
    ],
)
def test_identify_tool_invalid_table_names_line(identify: Command, table: str | None, message: str) -> None:
    if table is not None:
        Path("poses.csv").write_text(table)
    assert message in refusal(identify("--from", "poses.csv"))


SITE = """
[robot]
url = "rtde+tcp://192.0.2.1"
[sensor]
url = "netft+udp://192.0.2.2"
"""


@pytest.mark.full
def test_identify_tool_rehearsal_uses_configured_kinds(identify: Command) -> None:
    code, _, errors = identify("--virtual", config=SITE)
    assert code == 2
    assert "rehearse with --robot rtde --sensor netft" in errors
    quick = "--settle-s", "0.3", "--average-s", "0.3"
    code, output, _ = identify("--virtual", "--robot", "rtde", "--sensor", "netft", *quick, config=SITE)
    assert code == 0
    assert "6 poses" in output


def test_identify_tool_does_not_overwrite_its_input(identify: Command) -> None:
    assert "would overwrite the configuration" in refusal(identify("--virtual", "-o", "c.toml"))
    Path("poses.csv").touch()
    text = refusal(identify("--from", "poses.csv", "--save", "./poses.csv"))
    assert "would overwrite the table" in text
    assert "no such folder" in refusal(identify("--virtual", "-o", "none/tool.toml"))


def test_run_with_known_bias_and_tool_needs_no_zero(bench: Callable[..., Any]) -> None:
    tool = {"mass_kg": 3.0, "centre_of_gravity_mm": (0.0, 0.0, 80.0)}
    run = bench(sensor={"tare": False}, tool=tool, cell={"tool": tool})
    free = [record for record in run.cycles if record.phase == "approach" and record.depth < 0.002]
    assert max(abs(record.force) for record in free) < 0.1
    assert not any("zero taken" in text for text in run.texts("sensor"))
    assert run.result.outcome is Outcome.COMPLETED
