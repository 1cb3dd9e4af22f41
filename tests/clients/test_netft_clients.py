"""Two unmodified third-party clients of a Net F/T at the emulated box in a separate process."""

import json
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

pytestmark = pytest.mark.live

IN_CONTACT = """
[sensor]
emulated = "netft"
[cell]
start_position_mm = [900.0, -100.0, 588.0]
arm.compliance = "rigid"
[cell.netft]
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

PYNETFT = """
import json, sys, time
from pynetft import Client, Config
client = Client(Config(sensor_host=sys.argv[1], rdt_port=int(sys.argv[2]), http_port=int(sys.argv[3])))
client.start()
assert client.wait_for_first_sample(5.0)
time.sleep(0.5)
before = client.latest_sample()
client.bias()
# A record on its way during the bias is taken for the newest, and those of the new stream for older ones up to there.
for _ in range(40):
    time.sleep(0.1)
    if client.latest_sample().force[2] == 0.0:
        break
after, health = client.latest_sample(), client.health()
client.stop()
print(json.dumps({
    "before": before.force, "unit": before.force_unit.value, "after": after.force, "sequence": before.rdt_sequence,
    "product": health.sensor_configuration.product_name, "state": health.state.value,
    "wrong": [health.malformed_count, health.ft_stall_count, health.ft_backward_count, health.device_error_count,
              health.reconnect_count],
}))
"""

NETFT = """
import json, sys, time
from NetFT import Sensor
sensor = Sensor(sys.argv[1])
one = sensor.getMeasurement()
mean = sensor.tare(20)
tared = sensor.getForce()
sensor.zero()
sensor.startStreaming()
time.sleep(0.3)
streamed = sensor.force()
sensor.stopStreaming()
print(json.dumps({"one": one, "mean": mean, "tared": tared, "streamed": streamed}))
"""


@contextmanager
def emulated(configuration: Path, url: str) -> Iterator[tuple[int, int]]:
    """Emulate a box in a separate process; yield the ports of its records and of its page."""
    command = (sys.executable, "-m", "hil_bridge", "emulate", "sensor", str(configuration), "--json")
    process = subprocess.Popen((*command, "--sensor-port", url), stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        reported = json.loads(process.stdout.readline() or "{}").get("sensor")
        if reported is None:
            pytest.fail("the emulator did not begin")
        wire, _, page = reported.partition("?http_port=")
        yield int(wire.rpartition(":")[2]), int(page)
    finally:
        process.terminate()
        process.communicate(timeout=10.0)


def run_script(python: Path, script: str, *arguments: object) -> dict[str, object]:
    """Run a script with a client, and return what it prints."""
    done = subprocess.run(
        [python, "-c", script, *map(str, arguments)], capture_output=True, text=True, check=False, timeout=30
    )
    assert done.returncode == 0, done.stderr
    result: dict[str, object] = json.loads(done.stdout)
    return result


@pytest.fixture
def configuration(tmp_path: Path) -> Path:
    file = tmp_path / "box.toml"
    file.write_text(IN_CONTACT)
    return file


@pytest.mark.timeout(300)
def test_pynetft_reads_page_streams_force_and_biases(
    client_python: Callable[..., Path], configuration: Path
) -> None:
    python = client_python("pynetft==2.1.3")
    with emulated(configuration, "netft+udp-bind://127.0.0.1:0") as (records, page):
        reported = run_script(python, PYNETFT, "127.0.0.1", records, page)
    assert reported["product"] == "Net F/T emulator"
    assert (reported["state"], reported["unit"]) == ("streaming", "N")
    assert reported["before"] == pytest.approx([0.0, 0.0, FZ], abs=1e-3)
    assert reported["after"] == pytest.approx([0.0, 0.0, 0.0], abs=1e-3)
    assert isinstance(reported["sequence"], int)
    assert reported["sequence"] > 300
    assert reported["wrong"] == [0] * 5


@pytest.mark.timeout(300)
def test_netft_reads_single_records_and_streams(
    client_python: Callable[..., Path], configuration: Path
) -> None:
    """It supports only port 49152, so the box has a separate address on this computer."""
    python, host = client_python("NetFT==2.0.1"), "127.49.152.1"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((host, 49152))
        except OSError as error:
            pytest.skip(f"{host}:49152 cannot be had: {error}")
    with emulated(configuration, f"netft+udp-bind://{host}:49152?http_port=0"):
        reported = run_script(python, NETFT, host)
    counts = pytest.approx([0.0, 0.0, FZ * 1e6], abs=1e3)
    for name in ("one", "mean", "streamed"):
        six = reported[name]
        assert isinstance(six, list)
        assert six[:3] == counts, name
    assert reported["tared"] == pytest.approx([0.0, 0.0, 0.0], abs=1e3)
