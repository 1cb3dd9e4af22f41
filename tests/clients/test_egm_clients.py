"""Unmodified third-party EGM clients with the emulated robot in another process, in real time."""

import json
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.live

Python = Callable[..., Path]
PATIENCE_S = 60
SPEED_MM_S = 5.0
"""Speed along the path that the clients stream."""

STREAM = """
import json, sys, time
import numpy as np

def joined(receive, send, cycles, speed):
    '''Stream a straight way, cycle by cycle; the figures of it.'''
    ok, state = receive(10.0)
    assert ok, "no datagram came"
    first = {"seqno": state.robot_message.header.seqno, "joints": len(state.joint_angles)}
    position, orientation = place(state)
    behind, answered = [], 0
    for cycle in range(cycles):
        way = np.array([speed * 0.004 * cycle, 0.0, 0.0])
        assert send(position + way, orientation, np.array([speed, 0.0, 0.0, 0.0, 0.0, 0.0]))
        ok, state = receive(1.0)
        assert ok, f"no datagram in cycle {cycle}"
        answered += 1
        behind.append(float(np.linalg.norm(place(state)[0] - position - way)))
    done = {"motors": state.motors_on, "rapid": state.rapid_running, "mci": state.robot_message.mciState.state}
    fallen_silent = time.monotonic()
    while True:
        ok, newer = receive(0.3)
        if not ok:
            break
        state, at = newer, time.monotonic()
    return {
        "first": first, "answered": answered, "behind_mm": behind, "moved": done,
        "silent_after_s": at - fallen_silent, "last_mci": state.robot_message.mciState.state,
        "left_mm": place(state)[0].tolist(), "sent_mm": (position + way).tolist(),
    }
"""
FLO = """
from ABBRobotEGM import EGM

def place(state):
    p, o = state.cartesian.pos, state.cartesian.orient
    return np.array([p.x, p.y, p.z]), np.array([o.u0, o.u1, o.u2, o.u3])

with EGM(port=int(sys.argv[1])) as egm:
    print(json.dumps(joined(egm.receive_from_robot, egm.send_to_robot_cart, int(sys.argv[2]), float(sys.argv[3]))))
"""
RPI = """
from abb_robot_client.egm import EGM

def place(state):
    return state.cartesian

egm = EGM(port=int(sys.argv[1]))
print(json.dumps(joined(egm.receive_from_robot, egm.send_to_robot_cart, int(sys.argv[2]), float(sys.argv[3]))))
"""

JOINTS = """
import json, sys
import numpy as np
from ABBRobotEGM import EGM

with EGM(port=int(sys.argv[1])) as egm:
    ok, state = egm.receive_from_robot(10.0)
    goal = state.joint_angles + np.array([1.0, 0.0, 0.0, 0.0, 0.0, 2.0])
    for cycle in range(int(sys.argv[2])):
        assert egm.send_to_robot(goal)
        ok, state = egm.receive_from_robot(1.0)
        assert ok
    print(json.dumps({"short_deg": (goal - state.joint_angles).tolist(), "converged": state.mci_convergence_met}))
"""
PATH = """
import json, sys
import numpy as np
from ABBRobotEGM import EGM

with EGM(port=int(sys.argv[1])) as egm:
    ok, first = egm.receive_from_robot(10.0)
    for cycle in range(int(sys.argv[2])):
        assert egm.send_to_robot_path_corr(np.array([0.0, 1.5, -0.5]), age=1)
        ok, state = egm.receive_from_robot(1.0)
        assert ok
    moved = [getattr(state.cartesian.pos, axis) - getattr(first.cartesian.pos, axis) for axis in "xyz"]
    print(json.dumps(moved))
"""


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


@contextmanager
def emulated_robot(port: int, settings: str, place: Path, options: str = "") -> Iterator[str]:
    """Emulate a robot in another process that sends to this port; yield the options of its URL."""
    config = place / "robot.toml"
    config.write_text(f"[cell.egm]\n{settings}\n")
    url = f"egm+udp://127.0.0.1:{port}{options}"
    command = [
        sys.executable,
        "-m",
        "hil_bridge",
        "emulate",
        "robot",
        str(config),
        "--robot-port",
        url,
        "--json",
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            assert line, process.stderr and process.stderr.read()
            address, _, served = json.loads(line)["robot"].partition("?")
            assert address == f"egm+udp-bind://127.0.0.1:{port}"
            yield served
        finally:
            process.terminate()


def figures(python: Path, program: str, place: Path, cycles: int, settings: str = "") -> Any:
    """Return figures of a client's stream, from a separate process."""
    port = free_port()
    with emulated_robot(port, settings, place):
        reported = subprocess.run(
            [python, "-c", STREAM + program, str(port), str(cycles), str(SPEED_MM_S)],
            capture_output=True,
            text=True,
            check=False,
            timeout=PATIENCE_S,
        )
    assert reported.returncode == 0, reported.stderr
    return json.loads(reported.stdout)


def check_stream(report: Any, cycles: int) -> None:
    """Check that the path follows the command within the model's lag, and that silence ends in the robot's timeout."""
    assert report["first"]["joints"] == 6
    assert report["answered"] == cycles
    assert report["moved"] == {"motors": True, "rapid": True, "mci": 3}
    steady = report["behind_mm"][400:]  # the ramp of half a second is over, and caught up with
    # delay of controller and servo 24 ms, position loop 20 ms, and the answer's own cycle: 50 ms; doubled for a busy
    # machine
    assert max(steady) < 2.0 * SPEED_MM_S * 0.05
    assert report["silent_after_s"] == pytest.approx(1.0, abs=0.3)
    assert report["last_mci"] == 1  # MCI_ERROR
    beyond = report["left_mm"][0] - report["sent_mm"][0]
    assert (
        0.0 < beyond <= SPEED_MM_S / 5.0 + 0.05
    )  # the last speed stays in force, within the speed over the gain


def test_abb_robot_egm_streams_poses_then_stops(client_python: Python, tmp_path: Path) -> None:
    result = figures(client_python("ABBRobotEGM==1.0.7"), FLO, tmp_path, 500)
    assert result["first"]["seqno"] >= 0
    check_stream(result, 500)


def test_abb_robot_client_streams_poses_to_an_older_robot(client_python: Python, tmp_path: Path) -> None:
    result = figures(client_python("abb_robot_client==0.4.0"), RPI, tmp_path, 500, 'rw = "6.10"')
    check_stream(result, 500)


def test_abb_robot_egm_guides_joints(client_python: Python, tmp_path: Path) -> None:
    result = figures(client_python("ABBRobotEGM==1.0.7"), JOINTS, tmp_path, 500, 'mode = "joint"')
    assert result["short_deg"] == pytest.approx([0.0] * 6, abs=0.02)  # two seconds, a time constant of 0.2 s
    assert result["converged"]


def test_abb_robot_egm_corrects_a_path(client_python: Python, tmp_path: Path) -> None:
    settings = 'mode = "path"\nsample_ms = 48.0\npath_speed_mm_s = 10.0\npath_mm = [5.0, 0.0, 0.0]'
    report = figures(client_python("ABBRobotEGM==1.0.7"), PATH, tmp_path, 40, settings)
    assert report[1:] == pytest.approx([1.5, -0.5], abs=0.02)
    assert 0.0 <= report[0] <= 5.0


RWS = """
import json, sys
from abb_robot_client.rws import RWS

robot = RWS(f"http://{sys.argv[1]}")
target = robot.get_robtarget()
print(json.dumps({
    "execution": robot.get_execution_state().ctrlexecstate,
    "motors": robot.get_controller_state(),
    "mode": robot.get_operation_mode(),
    "speed": robot.get_speedratio(),
    "task": robot.get_tasks()["T_ROB1"].excstate,
    "signal": robot.get_digital_io("EGM_STOP"),
    "joints": len(robot.get_jointtarget().robax),
    "position_mm": target.trans.tolist(),
    "external": target.extax.tolist(),
}))
robot.stop()
assert robot.get_execution_state().ctrlexecstate == "stopped"
"""


def test_abb_robot_client_reads_web_services(client_python: Python, tmp_path: Path) -> None:
    python = client_python("abb_robot_client==0.4.0")
    with emulated_robot(free_port(), "", tmp_path, "?rws=127.0.0.1:0") as served:
        reported = subprocess.run(
            [python, "-c", RWS, served.removeprefix("rws=")],
            capture_output=True,
            text=True,
            check=False,
            timeout=PATIENCE_S,
        )
    assert reported.returncode == 0, reported.stderr
    result = json.loads(reported.stdout)
    assert result["position_mm"] == pytest.approx([900.0, -100.0, 600.0], abs=0.01)
    assert min(result["external"]) > 8e9
    assert (result["execution"], result["motors"], result["mode"]) == ("running", "motoron", "AUTO")
    assert (result["speed"], result["task"], result["signal"], result["joints"]) == (100.0, "star", 0, 6)
