"""Tests of the robot over RTDE in real time, over TCP on this computer."""

import json
import math
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from hil_bridge.devices.robots.rtde.addresses import parse_address
from protocol.devices.rtde import packets
from protocol.devices.rtde.fields import Recipe
from protocol.devices.rtde.packets import Kind
from protocol.devices.rtde.states import Runtime
from protocol.devices.rtde.wires import Port

pytestmark = pytest.mark.live

CONFIG = """
[run]
period_ms = 20
[controller]
sample_ms = 20
[cell]
start_position_mm = [900, -100, 592]
"""


def command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "hil_bridge", *arguments]


def wait_until_fed(host: str, port: int) -> None:
    """Wait until another client is told that the input is in use. It also requests no_input, so it claims nothing."""
    asking = packets.inputs_request(("external_force_torque", "no_input"))
    for _ in range(200):
        with socket.create_connection((host, port), timeout=10) as rtde:
            rtde.sendall(asking)
            if b"IN_USE" in rtde.recv(100):
                return
        time.sleep(0.05)
    raise AssertionError("the force source holds no input")


def test_force_source_ends_with_time_or_robot() -> None:
    with subprocess.Popen(
        command("emulate", "robot", "--robot", "rtde", "--json"), stdout=subprocess.PIPE, text=True
    ) as serving:
        try:
            assert serving.stdout is not None
            url = json.loads(serving.stdout.readline())["robot"]
            feed = command("emulate", "force-source", url, "--duration")
            reported = subprocess.run(
                [*feed, "1"], capture_output=True, text=True, timeout=30, check=True
            ).stdout
            assert reported.startswith("sent the force for ")
            assert int(reported.split()[4]) > 10  # 100 on a machine with nothing else to do
            with subprocess.Popen([*feed, "60"], stderr=subprocess.PIPE, text=True) as until:
                host, _, port = url.partition("//")[2].partition("?")[0].partition(":")
                wait_until_fed(host, int(port))
                serving.send_signal(signal.SIGTERM)
                _, why = until.communicate(timeout=30)
            assert until.returncode == 3
            assert why.count("\n") == 1
        finally:
            serving.kill()


class Observer:
    """Client that only reads."""

    def __init__(self, host: str, port: int) -> None:
        self._rtde = socket.create_connection((host, port), timeout=10)
        names = ("timestamp", "actual_TCP_speed", "runtime_state")
        self._recipe = Recipe(1, names, ("DOUBLE", "VECTOR6D", "UINT32"))
        self._reader = packets.Reader()
        self._rtde.sendall(packets.version_request())
        self._rtde.sendall(packets.outputs_request(names, 125.0) + packets.encode(Kind.START))

    def __enter__(self) -> "Observer":
        return self

    def __exit__(self, *error: object) -> None:
        self._rtde.close()

    def next_state(self) -> tuple[float, float, int]:
        """Return the time by the controller's clock, s, the speed of the tool, m/s, and runtime_state."""
        while True:
            while (packet := self._reader.next_packet()) is not None:
                if packet.kind == Kind.DATA:
                    stamp, x, y, z, *_, runtime = self._recipe.unpack(packet.payload)
                    return stamp, math.hypot(x, y, z), int(runtime)
            self._reader.feed(self._rtde.recv(65536))


def test_killed_bridge_leaves_arm_and_program_stopped(tmp_path: Path) -> None:
    config = tmp_path / "ur.toml"
    config.write_text(CONFIG)
    serve = command("emulate", "cell", str(config), "--robot", "rtde", "--json")
    with subprocess.Popen(serve, stdout=subprocess.PIPE, text=True) as serving:
        try:
            assert serving.stdout is not None
            urls = json.loads(serving.stdout.readline())
            host, _, port = urls["robot"].partition("//")[2].partition("?")[0].partition(":")
            devices = ["--robot", urls["robot"], "--sensor", urls["sensor"], "--tool-mass-kg", "0.5"]
            run = command("run", str(config), *devices, "--no-view", "--no-record")
            with (
                Observer(host, int(port)) as observed,
                subprocess.Popen(run, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as bridge,
            ):
                fast = 0
                while fast < 20:  # on its way down, not only on its lift before
                    _, speed, _ = observed.next_state()
                    fast = fast + 1 if speed > 0.002 else 0
                bridge.kill()
                stamp, speed, runtime = observed.next_state()
                ends = stamp + 2.0
                while (speed > 0.0 or runtime != Runtime.STOPPED) and stamp < ends:
                    stamp, speed, runtime = observed.next_state()
            assert (speed, runtime) == (0.0, Runtime.STOPPED)
        finally:
            serving.kill()


def test_upload_of_80_kb_does_not_delay_state() -> None:
    """The state was 0.5 s late or more when such a text was parsed in the loop."""
    row = "    if read_input_integer_register(24) == 7:\n      servoj(q, 0, 0, 0.002, 0.1, 300)\n    end\n"
    unused = f"  def unused(q):\n{row * (80_000 // len(row))}  end\n"
    text = f"def long():\n{unused}  while True:\n    sync()\n  end\nend\n"
    with subprocess.Popen(
        command("emulate", "robot", "--robot", "rtde", "--json"), stdout=subprocess.PIPE, text=True
    ) as serving:
        try:
            assert serving.stdout is not None
            url = json.loads(serving.stdout.readline())["robot"]
            address = parse_address(url.removeprefix("rtde+"))
            with (
                Observer(address.host, address.ports[Port.RTDE]) as observed,
                socket.create_connection((address.host, address.ports[Port.SCRIPT]), timeout=10) as script,
            ):
                newest, _, runtime = observed.next_state()
                script.sendall(text.encode())
                longest = 0.0
                while runtime != Runtime.PLAYING:
                    stamp, _, runtime = observed.next_state()
                    longest, newest = max(longest, stamp - newest), stamp
            assert longest < 0.1
        finally:
            serving.kill()
