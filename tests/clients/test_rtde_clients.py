"""Unmodified third-party ur_rtde at our emulated controller: in separate processes, over loopback.

Its ports are constants, so each test has a separate address.
"""

import json
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from protocol.devices.rtde import packets

pytestmark = pytest.mark.live

UR_RTDE = "ur_rtde==1.6.5"
PATIENCE_S = 40


def start_own_client(*arguments: str) -> "subprocess.Popen[str]":
    command = [sys.executable, "-m", "hil_bridge", *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@contextmanager
def ended(process: "subprocess.Popen[str]") -> Iterator["subprocess.Popen[str]"]:
    try:
        yield process
    finally:
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=PATIENCE_S)


@contextmanager
def emulated(host: str, *more: str) -> Iterator[None]:
    """Emulate a controller on a loopback address; yield the address."""
    with socket.socket() as probe:
        try:
            probe.bind((host, 30004))
        except OSError as error:
            pytest.skip(f"the port 30004 of {host} cannot be had: {error}")
    arguments = ("emulate", "robot", *more, "--robot", "rtde", "--robot-port", f"rtde+tcp-listen://{host}")
    with ended(start_own_client(*arguments, "--json")) as process:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line, process.communicate()[1]
        assert json.loads(line)["robot"] == f"rtde+tcp://{host}"
        yield


def run_script(python: Path, script: str, arguments: Sequence[str]) -> dict[str, Any]:
    """Run a script of the client; return the JSON of its last line."""
    done = subprocess.run(
        [python, "-c", script, *arguments], capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    result: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return result


SERVO = """
import json, math, sys, time
from rtde_control import RTDEControlInterface
from rtde_receive import RTDEReceiveInterface

host = sys.argv[1]
receive = RTDEReceiveInterface(host)
told = {"first": receive.getActualTCPPose(), "mode": receive.getRobotMode(), "safety": receive.getSafetyMode()}
control = RTDEControlInterface(host)
told["runtime"] = receive.getRuntimeState()
start = receive.getActualTCPPose()
sent, got, good = [], [], 0
for k in range(500):
    period = control.initPeriod()
    target = list(start)
    target[2] -= 0.01 * (1 - math.cos(2 * math.pi * k / 500))
    good += control.servoL(target, 0, 0, 0.002, 0.1, 300)
    sent.append((receive.getTimestamp(), target[2]))
    got.append((receive.getTimestamp(), receive.getActualTCPPose()[2]))
    control.waitPeriod(period)
told.update(good=good, sent=sent, got=got, stamps=len({stamp for stamp, _ in got}))
control.servoStop()
time.sleep(0.3)
told["speed"] = receive.getActualTCPSpeed()
told["moved"] = control.moveL([start[0], start[1] + 0.03, *start[2:]], 0.1, 0.5)
told["there"] = receive.getActualTCPPose()
told["offset"] = control.getTCPOffset()
told["joints"] = control.getInverseKinematics(start)
told["stop"] = control.triggerProtectiveStop()
time.sleep(0.1)
told["stopped"] = [receive.isProtectiveStopped(), receive.getSafetyMode(), receive.getRuntimeState()]
told["refused"] = control.servoL(start, 0, 0, 0.002, 0.1, 300)
control.disconnect()
receive.disconnect()
print(json.dumps(told))
"""


def lag_of(sent: list[list[float]], got: list[list[float]]) -> float:
    """Return the delay of the path behind the targets, s, in steps of 2 ms, by the best fit."""

    def misfit(steps: int) -> float:
        return sum((place - sent[k - steps][1]) ** 2 for k, (_, place) in enumerate(got) if k >= 120)

    return 0.002 * min(range(120), key=misfit)


def test_ur_rtde_servos_stops_and_sees_protective_stop(client_python: Callable[..., Path]) -> None:
    python = client_python(UR_RTDE)
    with emulated("127.0.0.21"):
        reported = run_script(python, SERVO, ["127.0.0.21"])
    assert reported["first"][:3] == pytest.approx([0.9, -0.1, 0.6], abs=1e-4)
    assert (reported["mode"], reported["safety"], reported["runtime"]) == (7, 1, 2)
    assert reported["good"] == 500
    lowest = min(place for _, place in reported["got"])
    assert lowest == pytest.approx(0.58, abs=2e-3)
    assert (
        0.04 < lag_of(reported["sent"], reported["got"]) < 0.2
    )  # the lookahead, the link, and a busy machine
    assert max(map(abs, reported["speed"][:3])) < 1e-6
    assert reported["moved"]
    assert reported["there"][1] == pytest.approx(-0.07, abs=1e-3)
    assert reported["offset"] == pytest.approx([0.0, 0.0, 0.2, 0.0, 0.0, 0.0])
    assert len(reported["joints"]) == 6
    assert reported["stopped"] == [True, 3, 4]
    assert not reported["refused"]


CONTACT = """
import json, sys, time
from rtde_control import RTDEControlInterface
from rtde_receive import RTDEReceiveInterface

host = sys.argv[1]
receive = RTDEReceiveInterface(host)
flags = RTDEControlInterface.FLAG_UPLOAD_SCRIPT | RTDEControlInterface.FLAG_NO_EXT_FT
control = RTDEControlInterface(host, 500.0, flags)
start = receive.getActualTCPPose()
free = receive.getActualTCPForce()
control.moveL([*start[:2], 0.588, *start[3:]], 0.05, 0.5)
time.sleep(0.2)
told = {"free": free, "contact": receive.getActualTCPForce()}
control.stopScript()
control.disconnect()
receive.disconnect()
print(json.dumps(told))
"""


def test_ur_rtde_reads_force_of_force_source(client_python: Callable[..., Path]) -> None:
    python = client_python(UR_RTDE)
    with (
        emulated("127.0.0.22"),
        ended(start_own_client("emulate", "force-source", "rtde+tcp://127.0.0.22")) as source,
    ):
        wait_for_force("127.0.0.22")
        reported = run_script(python, CONTACT, ["127.0.0.22"])
        assert source.poll() is None
    # an arm that was not given a force yet tells its own estimate, with an offset of some newtons
    assert reported["free"] == pytest.approx([0.0] * 6, abs=5.5)
    assert reported["contact"][2] == pytest.approx(10.0, abs=0.5)


SETTINGS = """
import json, sys, time
from rtde_control import RTDEControlInterface
from rtde_io import RTDEIOInterface
from rtde_receive import RTDEReceiveInterface

host = sys.argv[1]
receive = RTDEReceiveInterface(host)
control, io = RTDEControlInterface(host), RTDEIOInterface(host)

def force():
    time.sleep(0.3)
    return receive.getActualTCPForce()[2]

def took(up):
    x, y, z, *turn = receive.getActualTCPPose()
    begin = receive.getTimestamp()
    control.moveL([x, y, z + up, *turn], 0.1, 1.2)
    return receive.getTimestamp() - begin

told = {"full": took(0.02)}
io.setSpeedSlider(0.25)
time.sleep(0.2)
told["quarter"], told["slider"] = took(-0.02), receive.getTargetSpeedFraction()
io.setSpeedSlider(1.0)
control.zeroFtSensor()
before = force()
control.setPayload(1.5, [0.0, 0.0, 0.0])
told["changed"] = force() - before
told["payload"] = receive.getPayload()
control.stopScript()
control.disconnect()
receive.disconnect()
print(json.dumps(told))
"""


def test_ur_rtde_sets_slider_and_payload(client_python: Callable[..., Path]) -> None:
    python = client_python(UR_RTDE)
    with emulated("127.0.0.23"):
        reported = run_script(python, SETTINGS, ["127.0.0.23"])
    assert reported["slider"] == pytest.approx(0.25)
    # 20 mm at 0.1 m/s and 1.2 m/s^2 take 0.28 s, at a quarter of that speed 0.82 s and more; a busy machine adds some
    assert reported["quarter"] > 2.0 * reported["full"] > 0.5
    assert reported["quarter"] > 0.8
    # the arm carries 0.5 kg: the weight of the other kilogram is taken off a force that has none of it
    assert reported["payload"] == pytest.approx(1.5)
    assert reported["changed"] == pytest.approx(1.0 * 9.82, abs=1.0)


def wait_for_force(host: str) -> None:
    """Wait until another client is told that the input is in use. It also requests no_input, so it claims nothing."""
    for _ in range(200):
        with socket.create_connection((host, 30004), timeout=PATIENCE_S) as rtde:
            rtde.sendall(packets.inputs_request(("external_force_torque", "no_input")))
            if b"IN_USE" in rtde.recv(100):
                time.sleep(1.0)  # until its program of one line, which enables the input, has run
                return
        time.sleep(0.05)
    raise AssertionError("the force source holds no input")


FORCE = """
import json, sys, time
from rtde_control import RTDEControlInterface
from rtde_receive import RTDEReceiveInterface

host = sys.argv[1]
receive = RTDEReceiveInterface(host)
control = RTDEControlInterface(host)
told = {"touched": control.moveUntilContact([0, 0, -0.02, 0, 0, 0]), "at": receive.getActualTCPPose()[2]}
limits = [0.1, 0.1, 0.02, 0.2, 0.2, 0.2]
told["pressed"] = control.forceMode([0.0] * 6, [0, 0, 1, 0, 0, 0], [0, 0, -10, 0, 0, 0], 2, limits)
time.sleep(3.0)
forces = []
for _ in range(50):
    forces.append(receive.getActualTCPForce()[2])
    time.sleep(0.02)
told["force"] = sum(forces) / len(forces)
told["ended"] = control.forceModeStop()
told["jogged"] = control.jogStart([0, 0, 0.02, 0, 0, 0])
time.sleep(0.2)
speeds = []
for _ in range(40):
    speeds.append(receive.getActualTCPSpeed()[2])
    time.sleep(0.02)
told["speed"] = sum(speeds) / len(speeds)
told["stopped"] = control.jogStop()
time.sleep(0.2)
there = receive.getActualTCPPose()
told["sent"] = control.servoC([there[0], there[1] + 0.02, *there[2:]], 0.1, 0.5, 0.0)
time.sleep(1.5)
told["moved"] = receive.getActualTCPPose()[1] - there[1]
control.servoStop()
control.stopScript()
control.disconnect()
receive.disconnect()
print(json.dumps(told))
"""


def test_ur_rtde_holds_force_in_force_mode(client_python: Callable[..., Path]) -> None:
    """The surface of the emulated cell responds: the arm stops at contact, and presses with the target force."""
    python = client_python(UR_RTDE)
    with emulated("127.0.0.24"):
        reported = run_script(python, FORCE, ["127.0.0.24"])
    assert all(reported[name] for name in ("touched", "pressed", "ended", "jogged", "stopped", "sent"))
    assert reported["at"] == pytest.approx(0.589, abs=2e-3)
    assert reported["force"] == pytest.approx(
        10.0, abs=1.5
    )  # the arm's own measurement has an offset of some newtons
    assert reported["speed"] == pytest.approx(0.02, abs=2e-3)  # one reading has a noise of some mm/s
    assert reported["moved"] == pytest.approx(0.02, abs=1e-3)


def test_ur_rtde_detects_local_control(client_python: Callable[..., Path], tmp_path: Path) -> None:
    python = client_python(UR_RTDE)
    config = tmp_path / "local.toml"
    config.write_text("[cell.rtde]\nremote_control = false\n")
    script = (
        "import json, sys\nfrom rtde_control import RTDEControlInterface\ntry:\n"
        "    RTDEControlInterface(sys.argv[1])\nexcept RuntimeError as error:\n"
        "    print(json.dumps({'refusal': str(error)}))\n"
    )
    with emulated("127.0.0.23", str(config)):
        reported = run_script(python, script, ["127.0.0.23"])
    assert "remote control" in reported["refusal"].lower()


URX = ("urx==0.11.0", "math3d==4.0.0", "numpy==1.26.4")
"""python-urx with its dependencies; of these it declares only math3d."""
PLAYS = """
import json, sys, time
from urx.urrobot import URRobot

robot = URRobot(sys.argv[1])
try:
    start = robot.getl()
    goal = [start[0], start[1] + 0.03, *start[2:]]
    robot.movel(goal, acc=0.5, vel=0.1, wait=False)
    time.sleep(2.0)
    there = robot.getl()
    robot.set_digital_out(1, True)
    time.sleep(0.5)
    print(json.dumps({"start": start, "there": there, "out": robot.get_digital_out(1)}))
finally:
    robot.close()
"""


@pytest.mark.parametrize("version", ["3.1.0.0", "3.2.0.0", "3.5.0.0", "5.12.0.0"])
def test_python_urx_moves_robot_of_each_version(version: str, client_python: Callable[..., Path]) -> None:
    python, host = client_python(*URX), "127.0.0.26"
    model = ("--set", "cell.rtde.model=ur10", "--set", "cell.rtde.cycle_ms=8.0") if version[0] == "3" else ()
    with emulated(host, "--set", f"cell.rtde.version={version}", *model):
        reported = run_script(python, PLAYS, [host])
    assert reported["there"][1] - reported["start"][1] == pytest.approx(0.03, abs=2e-3)
    # its reader knows parts of the mode of 38 and 46 bytes; behind one of 47 it reads outputs of 16 bits
    assert reported["out"] == (version < "3.5")
