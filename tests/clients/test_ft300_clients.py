"""Unmodified third-party client of an FT 300 at the emulated sensor's pseudo-terminal."""

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.live

IN_CONTACT = """
[sensor]
emulated = "ft300"
[cell]
start_position_mm = [900.0, -100.0, 588.0]
arm.compliance = "rigid"
[cell.ft300]
boot_s = 0.0
noise_n = 0.0
noise_nm = 0.0
wander_n = 0.0
creep_share = 0.0
vibration_n = 0.0
motion_n = 0.0
"""
FZ = 0.5 * 9.80665 - 2.0 * 5.0
"""Weight of the tool below the sensor minus the push of 5 N/mm over 2 mm, N."""

STREAM_THEN_ASK = """
import json, sys, time
from ft300python import FT300ModbusRTU, FT300Stream
stream = FT300Stream(sys.argv[1], 1, zero_reset=False)
streamed = [stream.get_force_torque() for _ in range(20)]
del stream
time.sleep(0.3)
asked = FT300ModbusRTU(sys.argv[1], 1, zero_reset=False)
print(json.dumps({
    "streamed": streamed, "asked": asked.get_force_torque(), "serial": asked.get_serial_number(),
    "year": asked.get_production_year(), "acceleration": asked.get_acceralation(),
}))
asked.disconnect()
"""


@contextmanager
def emulated(configuration: Path) -> Iterator[str]:
    """Emulate a sensor in a separate process; yield its serial port."""
    command = (sys.executable, "-m", "hil_bridge", "emulate", "sensor", str(configuration), "--json")
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        url = json.loads(process.stdout.readline() or "{}").get("sensor")
        if url is None:
            pytest.fail("the emulator did not begin")
        yield url.removeprefix("ft300+serial://").partition("?")[0]
    finally:
        process.terminate()
        process.communicate(timeout=10.0)


@pytest.mark.timeout(300)
def test_ft300python_streams_and_polls_contact_force(
    client_python: Callable[..., Path], tmp_path: Path
) -> None:
    """It needs the old pymodbus, and closes the port between its query and the stream."""
    python, file = client_python("ft300python==1.0.2", "pymodbus==2.5.3"), tmp_path / "sensor.toml"
    file.write_text(IN_CONTACT)
    with emulated(file) as port:
        done = subprocess.run(
            [python, "-c", STREAM_THEN_ASK, port], capture_output=True, text=True, check=False, timeout=60
        )
    assert done.returncode == 0, done.stderr
    reported: dict[str, Any] = json.loads(done.stdout)
    load = pytest.approx([0.0, 0.0, FZ, 0.0, 0.0, 0.0], abs=0.011)
    assert reported["asked"] == load
    assert all(six == load for six in reported["streamed"])
    assert reported["serial"] == [0x4654, 0x5300, 1234, 0]
    assert reported["year"] == 2021
    assert reported["acceleration"] == [0.0, 0.0, -1.0]
