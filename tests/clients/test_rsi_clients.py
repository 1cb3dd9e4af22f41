"""RSIPI, an unmodified third-party client, at the emulated KUKA controller in a separate process."""

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

RSIPI = "RSIPI==0.3.0"
ETHERNET = """<ROOT>
<CONFIG><IP_NUMBER>127.0.0.1</IP_NUMBER><PORT>{port}</PORT><SENTYPE>ImFree</SENTYPE><ONLYSEND>FALSE</ONLYSEND></CONFIG>
<SEND><ELEMENTS>
<ELEMENT TAG="DEF_RIst" TYPE="DOUBLE" INDX="INTERNAL" />
<ELEMENT TAG="DEF_RSol" TYPE="DOUBLE" INDX="INTERNAL" />
<ELEMENT TAG="DEF_Delay" TYPE="LONG" INDX="INTERNAL" />
</ELEMENTS></SEND>
<RECEIVE><ELEMENTS>{channels}</ELEMENTS></RECEIVE>
</ROOT>
"""
CHANNEL = '<ELEMENT TAG="RKorr.{axis}" TYPE="DOUBLE" INDX="{index}" HOLDON="{holdon}" />'

HEAD = """
import json, sys, time
from RSIPI.rsi_api import RSIAPI
from RSIPI.fault_injection import suspended
api = RSIAPI(sys.argv[1], rsi_mode=sys.argv[2], max_cartesian_rate=float(sys.argv[3]))
api.start()
assert api.wait_for_connection(20.0)
time.sleep(0.3)
client = api.client
def state():
    told = client.send_variables
    return {
        "actual": told["RIst"],
        "planned": told["RSol"],
        "late": int(told["Delay"]["D"]),
        "clock": client.current_ipoc(),
    }
"""
MOVE = """
before = state()
began = time.monotonic()
api.motion.update_cartesian(X=float(sys.argv[4]), Z=float(sys.argv[5]))
time.sleep(1.0)
during = state()
passed = time.monotonic() - began
api.motion.update_cartesian(**({"X": 0.0, "Z": 0.0} if sys.argv[2] == "relative" else {}))
time.sleep(0.5)
after = state()
api.stop()
print(json.dumps({"before": before, "during": during, "after": after, "passed": passed}))
"""
STALL = """
before = state()
with suspended(client.network_process.pid):
    time.sleep(0.2)
time.sleep(0.5)
once = state()
with suspended(client.network_process.pid):
    time.sleep(1.0)
time.sleep(0.5)
twice = state()
time.sleep(0.5)
after = state()
api.stop()
print(json.dumps({"before": before, "once": once, "twice": twice, "after": after}))
"""


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


@contextmanager
def emulated(place: Path, settings: str) -> Iterator[int]:
    """Emulate the controller in a separate process; yield the port that it sends to."""
    config, port = place / "rsi.toml", free_port()
    config.write_text(f"[cell.rsi]\n{settings}")
    command = (
        sys.executable,
        "-m",
        "hil_bridge",
        "emulate",
        "robot",
        str(config),
        "--robot",
        "rsi",
        "--json",
    )
    process = subprocess.Popen(
        (*command, "--robot-port", f"rsi+udp://127.0.0.1:{port}"), stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout is not None
        reported = json.loads(process.stdout.readline() or "{}")
        assert reported == {"robot": f"rsi+udp-bind://127.0.0.1:{port}"}
        yield port
    finally:
        process.terminate()
        process.communicate(timeout=10.0)


def run_client_script(
    python: Path, place: Path, port: int, script: str, *arguments: object, holdon: int = 0
) -> Any:
    """Run a script with RSIPI, and return what it prints."""
    channels = [
        CHANNEL.format(axis=axis, index=index + 1, holdon=holdon) for index, axis in enumerate("XYZABC")
    ]
    file = place / "ethernet.xml"
    file.write_text(ETHERNET.format(port=port, channels="".join(channels)))
    done = subprocess.run(
        [python, "-c", HEAD + script, file, *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
        cwd=place,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.timeout(400)
def test_rsipi_relative_corrections_move_robot_each_cycle(
    client_python: Callable[..., Path], tmp_path: Path
) -> None:
    python = client_python(RSIPI)
    with emulated(tmp_path, "restart_s = 0.5\n") as port:
        reported = run_client_script(python, tmp_path, port, MOVE, "relative", 0.0, 0.01, -0.02)
    before, after = reported["before"], reported["after"]
    assert before["planned"]["Z"] == after["planned"]["Z"] == 600.0  # RSol stays where the program is
    cycles = reported["during"]["clock"] - before["clock"]
    assert cycles == pytest.approx(1e3 * reported["passed"], abs=200)  # IPOC counts milliseconds
    distance = after["actual"]["Z"] - before["actual"]["Z"]
    accepted = -distance / 0.02
    assert accepted == pytest.approx(cycles / 4 - (after["late"] - before["late"]), abs=60)
    assert after["actual"]["X"] - before["actual"]["X"] == pytest.approx(-distance / 2.0, abs=1e-3)


@pytest.mark.timeout(400)
def test_rsipi_absolute_corrections_are_reached_and_held(
    client_python: Callable[..., Path], tmp_path: Path
) -> None:
    python = client_python(RSIPI)
    with emulated(tmp_path, 'mode = "absolute"\nrestart_s = 0.5\n') as port:
        reported = run_client_script(python, tmp_path, port, MOVE, "absolute", 0.1, 2.0, -5.0, holdon=1)
    for moment in ("during", "after"):
        result = reported[moment]["actual"]
        assert [result[axis] for axis in "XYZ"] == pytest.approx([902.0, -100.0, 595.0], abs=1e-3)


@pytest.mark.timeout(400)
def test_stalled_rsipi_stops_robot_at_late_limit(client_python: Callable[..., Path], tmp_path: Path) -> None:
    python = client_python(RSIPI)
    with emulated(tmp_path, "timeout = 100\nrestart_s = 6.0\n") as port:
        reported = run_client_script(python, tmp_path, port, STALL, "relative", 0.0)
    before, once, twice, after = (reported[moment] for moment in ("before", "once", "twice", "after"))
    assert once["late"] - before["late"] == pytest.approx(50, abs=30)  # 0.2 s of 4 ms, and it continues
    assert once["clock"] > before["clock"] + 500
    assert twice["clock"] == after["clock"]  # nothing came any more
    assert after["clock"] < once["clock"] + 1000
