"""Tests of the site tools as separate processes: two tapped lines, and a controller behind RFC 2217."""

import json
import os
import pty
import re
import select
import signal
import subprocess
import time
import tty
from pathlib import Path

import pytest

from tests.live.processes import HIL, PATIENCE_S, emulator_urls, start

pytestmark = pytest.mark.live


def test_two_tapped_lines_are_decoded_and_stored(tmp_path: Path) -> None:
    """The bytes of a read status and its acknowledge, each on the port that listens to its sender."""
    ports = [pty.openpty() for _ in range(2)]
    for _, slave in ports:
        tty.setraw(slave)
    (pc, _), (robot, _) = ports
    capture = tmp_path / "capture.txt"
    process = start(
        "monitor", *(f"s3+serial://{os.ttyname(slave)}" for _, slave in ports), "--save", str(capture)
    )
    try:
        ends = time.monotonic() + PATIENCE_S
        while not (capture.exists() and "PC 05" in capture.read_text()):
            assert time.monotonic() < ends
            os.write(pc, b"\x05")  # until it listens
            time.sleep(0.3)
        for line, data in ((robot, "06"), (pc, "10020008010013010000100318"), (robot, "06"), (pc, "04")):
            os.write(line, bytes.fromhex(data))
            time.sleep(0.05)
        assert process.stdout is not None
        first = process.stdout.readline()
        while "read status" not in first:  # bids without an answer come before
            assert "ENQ: no answer" in first
            first = process.stdout.readline()
        assert "PC→S3" in first
        assert "ACK" in first
        process.send_signal(signal.SIGINT)
        out, errors = process.communicate(timeout=PATIENCE_S)
        assert (process.returncode, errors) == (0, "")
        assert out.startswith("1 blocks")
        assert not select.select([pc, robot], [], [], 0.0)[0], "a monitor sends nothing"
    finally:
        process.kill()
        process.communicate()
        for pair in ports:
            for end in pair:
                os.close(end)
    assert "10 02 00 08 01 00 13 01 00 00 10 03 18" in capture.read_text()
    again = subprocess.run(
        [*HIL, "monitor", str(capture)], capture_output=True, text=True, check=True, timeout=PATIENCE_S
    )
    assert "read status, order" in again.stdout


def test_sensor_probe_on_terminal_ends_with_ctrl_c() -> None:
    emulator = start("emulate", "cell", "--json")
    mine, its = pty.openpty()
    try:
        url = emulator_urls(emulator)["sensor"]
        process = subprocess.Popen([*HIL, "probe", "sensor", url], stdin=its, stdout=its, stderr=its)
        messages, requested, ends = "", 0, time.monotonic() + PATIENCE_S
        while messages.partition("+Z: skipped")[2].count("Fz") < 2:
            assert time.monotonic() < ends, messages
            assert process.poll() is None, messages
            if select.select([mine], [], [], 0.2)[0]:
                messages += os.read(mine, 4096).decode()
            if messages.count("Enter skips it") > requested:
                requested += 1
                os.write(mine, b"\n")
        process.send_signal(signal.SIGINT)
        while process.poll() is None:
            if select.select([mine], [], [], 0.2)[0]:
                messages += os.read(mine, 4096).decode()
        assert process.returncode == 0
        assert "full scales  Fx 115  Fy 111  Fz 185 N" in messages
        assert re.search(r"stream +\d+ frames per second", messages)
        assert "Traceback" not in messages
    finally:
        emulator.terminate()
        emulator.communicate(timeout=PATIENCE_S)
        os.close(mine)
        os.close(its)


def test_probes_print_json_only() -> None:
    """Where the search for a link prints its attempts, they go to standard error."""
    emulator = start("emulate", "cell", "--json")
    try:
        urls = emulator_urls(emulator)
        reported = {
            device: subprocess.run(
                [*HIL, "probe", device, urls[device], "--json"],
                capture_output=True,
                text=True,
                check=True,
                timeout=PATIENCE_S,
            )
            for device in ("sensor", "robot")
        }
        sensor, robot = (json.loads(reported[device].stdout) for device in ("sensor", "robot"))
    finally:
        emulator.terminate()
        emulator.communicate(timeout=PATIENCE_S)
    assert sensor["sensor"] == urls["sensor"]
    assert len(sensor["noise"]) == len(sensor["wrench"]) == len(sensor["full_scales"]) == 6
    assert sensor["stream_hz"] > 50.0
    assert sensor["filter_delay_s"] >= 0.0
    assert (robot["kind"], robot["would_begin"], robot["refusals"]) == ("s3", True, [])
    assert {"name": "state", "text": "in standby"} in robot["rows"]
    assert robot["url"] == urls["robot"]
    assert "answered: at 900, -100, 600 mm" in reported["robot"].stderr


def test_controller_behind_device_server_is_probed(tmp_path: Path) -> None:
    """The server applies the client's settings, so parity can be wrong; the configuration found works unchanged."""
    cell = tmp_path / "cell.toml"
    cell.write_text('[cell.s3.link]\nparity = "N"\ndle_stuffing = "double"\naccepted_lengths = "data"\n')
    emulator = start(
        "emulate",
        "robot",
        str(cell),
        "--json",
        "--robot-port",
        "s3+rfc2217-listen://127.0.0.1:0?baudrate=9600&parity=N",
    )
    try:
        url = emulator_urls(emulator)["robot"].partition("?")[0]
        site = tmp_path / "site.toml"
        probe = subprocess.run(
            [*HIL, "probe", "robot", url, "-o", str(site)],
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )
        assert (probe.returncode, probe.stderr) == (0, "")
        assert "9600 8E1, length whole, 10h single, plain status" in probe.stdout
        for line in ('parity = "N"', 'dle_stuffing = "double"', 'length_style = "data"'):
            assert line in site.read_text().splitlines()
        doctor = subprocess.run(
            [*HIL, "doctor", str(site)], capture_output=True, text=True, timeout=PATIENCE_S, check=False
        )
        assert "ok    robot.url: 127.0.0.1 port" in doctor.stdout
        assert "fail  wires: a robot without a sensor" in doctor.stdout
        assert doctor.returncode == 3, "`run` would refuse it too, until a sensor is named"
    finally:
        emulator.terminate()
        emulator.communicate(timeout=PATIENCE_S)
