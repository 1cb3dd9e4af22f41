"""Tests of `hil-bridge conform` with clients in separate processes: unmodified ur_rtde, and clients with mistakes."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from hil_bridge.errors import ConfigError
from hil_bridge.lab.conform.client import ProcessClient
from hil_bridge.lab.conform.real_time import play_all, usual_port
from hil_bridge.lab.conform.robots.scenarios import Rules
from hil_bridge.lab.conform.robots.stage import RobotTrial
from hil_bridge.lab.conform.trial import ScenarioResult, choose_scenarios
from hil_bridge.settings.configuration import load_config

pytestmark = pytest.mark.live

UR_RTDE = "ur_rtde==1.6.5"
OURS = Path(__file__).with_name("rtde_clients.py")
SHORT = ("after_s=0.2", "watch_s=0.8", "react_s=0.3", "start_s=10", "run_s=0.6", "end_s=1")
PATIENCE_S = 60


def conform(*arguments: str) -> "subprocess.Popen[str]":
    rules = [word for rule in SHORT for word in ("--set", rule)]
    command = [sys.executable, "-m", "hil_bridge", "conform", "rtde", *rules, *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def judged(tmp_path: Path, *arguments: str) -> tuple[int, dict[str, Any], str]:
    """Return exit code, scenarios by name, and standard output."""
    place = tmp_path / "verdicts.json"
    process = conform("--json", str(place), *arguments)
    output, errors = process.communicate(timeout=PATIENCE_S)
    assert place.exists(), errors
    result = json.loads(place.read_text(encoding="utf-8"))
    return process.returncode, {one["name"]: one for one in result["scenarios"]}, output


def play_trial(
    command: list[str], names: list[str], listen: str | None = None, **rules: Any
) -> dict[str, ScenarioResult[Any]]:
    """Return the same from this process, which saves its start."""
    config = load_config(None, {"robot.emulated": "rtde"})
    requested = Rules(**{"after_s": 0.2, "watch_s": 0.8, "react_s": 0.3, "run_s": 0.6, "end_s": 0.5, **rules})
    trial = RobotTrial(config, usual_port(config, listen, command), requested, lambda: ProcessClient(command))
    return {one.name: one for one in play_all(trial, choose_scenarios(trial, names), print)}


SERVO = """
import math, os, sys
from rtde_control import RTDEControlInterface
from rtde_receive import RTDEReceiveInterface

host = os.environ["HIL_BRIDGE_HOST"]
receive = RTDEReceiveInterface(host)
control = RTDEControlInterface(host)
start = receive.getActualTCPPose()
for k in range(500):
    if receive.isProtectiveStopped() or receive.isEmergencyStopped():
        sys.exit("the robot has stopped")
    period = control.initPeriod()
    target = list(start)
    target[2] -= 0.01 * (1 - math.cos(2 * math.pi * k / 500))
    if not control.servoL(target, 0, 0, 0.002, 0.1, 300):
        sys.exit("the robot does not take the pose")
    control.waitPeriod(period)
control.servoStop()
control.disconnect()
receive.disconnect()
"""


def test_ur_rtde_passes(client_python: Callable[..., Path]) -> None:
    rules = {"run_s": 8.0, "start_s": 5.0, "react_s": 1.0, "watch_s": 1.3, "end_s": 3.0}
    python = str(client_python(UR_RTDE))
    names = ["nominal", "late", "refused", "stopped", "cut"]
    result = play_trial([python, "-c", SERVO], names, listen="rtde+tcp-listen://127.0.0.31", **rules)
    assert {name: (one.verdict.outcome.value, one.verdict.reason) for name, one in result.items()} == {
        name: ("passed", one.verdict.reason) for name, one in result.items()
    }
    assert [*result] == names
    nominal, stopped = result["nominal"].seen, result["stopped"].seen
    assert 0.005 < nominal.moved_m < 0.022  # a busy machine leaves out some of the way
    # of packages that come within one cycle the program sees the last: a busy machine made 37 of 500
    assert 10 <= nominal.orders == nominal.taken <= 500
    assert stopped.orders > 5
    assert stopped.after_stop == 0


RUNAWAY = """
import os, time
from rtde_control import RTDEControlInterface

control = RTDEControlInterface(os.environ["HIL_BRIDGE_HOST"])
control.speedL([0, 0, -0.01, 0, 0, 0], 0.5)
time.sleep(0.3)
os._exit(0)
"""


def test_ur_rtde_leaving_tool_moving_is_reported(client_python: Callable[..., Path]) -> None:
    python = str(client_python(UR_RTDE))
    result = play_trial(
        [python, "-c", RUNAWAY], ["nominal"], listen="rtde+tcp-listen://127.0.0.32", stand_s=0.5, start_s=10.0
    )
    assert result["nominal"].verdict.outcome == "failed"
    assert result["nominal"].verdict.reason.startswith("left the tool moving at ")
    assert 0.004 < result["nominal"].seen.left_m_s < 0.012  # a busy machine looks at it rarely


def command_with(mistake: str) -> list[str]:
    return [sys.executable, str(OURS), mistake]


def test_client_sending_after_protective_stop_is_reported(tmp_path: Path) -> None:
    junit = tmp_path / "junit.xml"
    scenarios = ("--only", "nominal", "--only", "stopped", "--junit", str(junit))
    code, result, output = judged(tmp_path, *scenarios, "--", *command_with("stubborn"))
    assert code == 4
    assert result["nominal"]["outcome"] == "passed", output
    stopped = result["stopped"]
    assert stopped["outcome"] == "failed"
    assert "motion orders after the stop" in stopped["reason"]
    assert stopped["reason"] in output
    assert stopped["evidence"]["after_stop"] > 10
    assert stopped["evidence"]["last_motion_s"] == pytest.approx(0.8, abs=0.3)
    failure = ElementTree.parse(junit).getroot().find(".//testcase[@name='stopped']/failure")
    assert failure is not None
    assert failure.get("message") == stopped["reason"]


@pytest.mark.parametrize(
    ("mistake", "message"),
    [
        ("crash", "failed by itself: ended by itself after 0."),
        ("garbage", "sent unreadable data"),
        ("deaf", "did not terminate within 0.5 s of the request, and was killed"),
        ("leap", "of its orders leap, by up to 20"),
    ],
)
def test_mistake_is_named(mistake: str, message: str) -> None:
    start_s = 3.0 if mistake == "garbage" else 10.0  # it is waited for to the end
    run_s = 3.0 if mistake in ("crash", "leap") else 0.6  # until it has made its mistake, which ends the run
    (one,) = play_trial(command_with(mistake), ["nominal"], start_s=start_s, run_s=run_s).values()
    assert one.verdict.outcome == "failed"
    assert message in one.verdict.reason
    if mistake == "crash":
        assert "by SIGSEGV" in one.verdict.reason
    if mistake == "deaf":
        assert "this client does not want to end" in one.output


def test_absent_client_fails_once_and_skips_the_rest() -> None:
    result = play_trial(["sleep", "60"], [], start_s=0.3)
    assert result["nominal"].verdict.reason == "never connected: nothing in 0.3 s"
    assert [one.verdict.outcome for one in result.values()] == ["failed", *["skipped"] * 5]


def test_client_failing_to_reconnect_is_reported() -> None:
    """Our client has no such logic: the watchdog stops its program, and it does not load it again."""
    result = play_trial(command_with("none"), ["cut"], comes_back=True, cut_s=0.3, back_s=0.5)
    assert result["cut"].verdict.outcome == "failed"
    assert result["cut"].verdict.reason.startswith("did not reconnect within 0.5 s, as declared")


def test_missing_command_is_invalid_input() -> None:
    with pytest.raises(ConfigError, match=r"cannot start .*: No such file or directory"):
        play_trial(["./no-such-client"], ["nominal"])


def test_ctrl_c_ends_all_processes(tmp_path: Path) -> None:
    reported = tmp_path / "pid"
    script = f"sleep 61 & echo $! > {reported}.new; mv {reported}.new {reported}; wait"
    process = conform("--set", "start_s=30", "--", "sh", "-c", script)
    for _ in range(1000):
        if reported.exists():
            break
        time.sleep(0.01)
    grandchild = int(reported.read_text(encoding="ascii"))
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130, errors
    for _ in range(200):
        if not alive(grandchild):
            return
        time.sleep(0.01)
    raise AssertionError(f"{grandchild} is still running")


def alive(number: int) -> bool:
    try:
        os.kill(number, 0)
        return Path(f"/proc/{number}/stat").read_text(encoding="ascii").split(")")[1].split()[0] != "Z"
    except (ProcessLookupError, FileNotFoundError):
        return False
