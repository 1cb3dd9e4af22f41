"""A sensor behind its UART gateway, from the URL to the closed loop, in virtual time over a paced line."""

import json
import statistics
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any

import pytest
from click.testing import CliRunner

from hil_bridge.cli.decode import decode
from hil_bridge.clock import Clock, run_virtual
from hil_bridge.devices.device_log import CallbackLog
from hil_bridge.devices.sensors.jr3.room import uart_line
from hil_bridge.devices.sensors.stream import ForceSensor
from hil_bridge.devices.wiring import Wiring
from hil_bridge.errors import ConfigError, DeviceError, TransportUnavailable
from hil_bridge.record import CycleRecord, EventKind, EventRecord, Outcome, SensorRecord
from hil_bridge.runs.compose import connect_sensor
from hil_bridge.runs.run_log import RunLog
from hil_bridge.runs.running import Running, running
from hil_bridge.runs.setup import Setup
from hil_bridge.runs.watchers import Listener
from hil_bridge.settings.configuration import Config, load_config, read_config
from hil_bridge.settings.devices import sensor_at
from hil_bridge.transports.urls import CONNECT_BYTES, LISTEN_BYTES

URL = "jr3-uart+memory:sensor"


# --- URL


@pytest.mark.parametrize(
    ("url", "wire"),
    [
        ("serial:///dev/ttyACM0", "serial:///dev/ttyACM0?baudrate=115200"),
        ("serial:///dev/ttyACM0?parity=E", "serial:///dev/ttyACM0?baudrate=115200&parity=E"),
        ("serial:///dev/x?baudrate=9600", "serial:///dev/x?baudrate=9600"),
        ("tcp://10.0.0.1:4000", "tcp://10.0.0.1:4000"),
        ("memory:x?latency_ms=5", "memory:x?baudrate=115200&latency_ms=5"),
        ("foo:", "foo:"),
    ],
)
def test_uart_connecting_url_gets_line_of_gateway(url: str, wire: str) -> None:
    assert uart_line(url, CONNECT_BYTES) == wire


@pytest.mark.parametrize(
    ("url", "wire"),
    [
        ("pty:", "pty:?baudrate=115200"),
        ("pty:?link=/tmp/jr3", "pty:?baudrate=115200&link=/tmp/jr3"),
        ("tcp-listen://127.0.0.1:0", "tcp-listen://127.0.0.1:0?baudrate=115200"),
        ("memory:x", "memory:x?baudrate=115200"),
    ],
)
def test_uart_listening_url_gets_line_of_gateway(url: str, wire: str) -> None:
    assert uart_line(url, LISTEN_BYTES) == wire


def refuse(url: str, error: type[Exception]) -> str:
    async def main() -> None:
        clock = Clock.running()
        await connect_sensor(sensor_at(Config(), url), Wiring("sensor", clock, CallbackLog()))

    with pytest.raises(error) as caught:
        run_virtual(main)
    return str(caught.value)


def test_uart_invalid_url_is_reported() -> None:
    assert "unknown scheme 'foo'" in refuse("jr3-uart+foo:x", ConfigError)
    assert "unknown option 'speed'" in refuse("jr3-uart+serial:///dev/x?speed=1", ConfigError)
    assert "unknown option 'gateway'" in refuse("jr3+can+memory:x?gateway=jr3", ConfigError)
    assert "no program listens" in refuse("jr3-uart+memory:none", TransportUnavailable)


@pytest.mark.parametrize(
    ("key", "value", "text"),
    [
        ("period_ms", 1.0, "period_ms must be at least 1.5625, what a frame takes at 115200 baud, got 1"),
        ("cutoff_hz", 0.62, "cutoff_hz must not be 0.62: on the line a byte of it looks like < or >"),
        ("cutoff_hz", 0.001, "cutoff_hz must be 0.01 … 655.35, or 0 for unfiltered, got 0.001"),
    ],
)
def test_uart_unsupported_setting_is_refused_in_one_line(
    key: str, value: float, text: str, tmp_path: Any
) -> None:
    path = tmp_path / "c.toml"
    path.write_text(f"[sensor.jr3.uart]\n{key} = {value}\n")
    with pytest.raises(ConfigError) as caught:
        load_config(path, {})
    assert str(caught.value).startswith(f"{path}: sensor.jr3.uart.{text}")


@pytest.mark.parametrize(("node", "bound"), [(0, "at least 1"), (128, "at most 127")])
def test_can_gateway_invalid_node_is_refused_in_one_line(node: int, bound: str, tmp_path: Any) -> None:
    path = tmp_path / "c.toml"
    path.write_text(f"[sensor.jr3.gateway]\nnode = {node}\n")
    with pytest.raises(ConfigError) as caught:
        load_config(path, {})
    assert str(caught.value) == f"{path}: sensor.jr3.gateway.node must be {bound}, got {node}"


def test_decode_jr3_uart_decodes_pasted_bytes() -> None:
    done = CliRunner().invoke(decode, ["jr3-uart", "3C 30 32 C8 00", "10 27 00 00 3E", "3C3031003E"])
    assert done.exit_code == 0
    assert [item["op"] for item in json.loads(done.output)] == ["start", "acknowledge"]
    done = CliRunner().invoke(decode, ["jr3-uart", "FF 3C 30 36 3E"])
    assert done.exit_code == 2
    assert [item["kind"] for item in json.loads(done.output)] == ["noise", "frame"]


# --- device and loop


@dataclass
@dataclass
class Served:
    """Run over the emulated cell with a UART gateway, not started, and its notices."""

    clock: Clock
    run: Running
    frames: list[SensorRecord]
    cycles: list[CycleRecord]
    events: list[EventRecord]

    @property
    def sensor(self) -> ForceSensor:
        return self.run.sensor


def with_cell(script: Callable[[Served], Awaitable[None]], **sections: Any) -> Served:
    sections.setdefault("sensor", {})["emulated"] = "jr3-uart"
    setup = Setup(read_config(sections))
    runs: list[Served] = []

    async def main() -> None:
        clock = Clock.running()
        frames, cycles, events = list[SensorRecord](), list[CycleRecord](), list[EventRecord]()
        arguments: dict[type, Any] = {
            SensorRecord: frames.append,
            CycleRecord: cycles.append,
            EventRecord: events.append,
        }
        async with running(setup, RunLog(clock, [Listener(arguments)])) as run:
            runs.append(Served(clock, run, frames, cycles, events))
            await script(runs[0])

    run_virtual(main)
    return runs[0]


def test_uart_sensor_starts_zeroes_and_stops() -> None:
    times: list[float] = []

    async def script(served: Served) -> None:
        begun = served.clock.now()
        assert (await served.sensor.ready()).full_scales == (115.0, 111.0, 185.0, 5.6, 5.2, 6.1)
        times.append(served.clock.now() - begun)
        await served.sensor.tare()
        times.append(served.clock.now() - begun)
        await served.clock.sleep_until(served.clock.now() + 10.0)
        assert max(map(abs, served.frames[-1].counts)) <= 4

    served = with_cell(script, sensor={"jr3": {"uart": {"period_ms": 2.0}}})
    # Boot 5.033 s, then two pauses of 1.1 s until the start, one more until the zero.
    assert times == [pytest.approx(7.34, abs=0.02), pytest.approx(8.35, abs=0.02)]
    assert len(served.frames) > 5000
    assert served.sensor.lost == 0
    assert served.events == []


@pytest.mark.parametrize(("kept_bytes", "seconds"), [(0, 1.25), (256, 0.99)])
def test_uart_sensor_close_waits_for_deaf_gateway(kept_bytes: int, seconds: float) -> None:
    """A stop that the gateway misses is repeated before the line is closed; a buffered one is not."""
    closed: list[float] = []

    async def script(served: Served) -> None:
        await served.sensor.ready()
        await served.sensor.tare()
        requested_at = served.clock.now()
        await served.sensor.aclose()
        closed.append(served.clock.now() - requested_at)

    with_cell(script, cell={"jr3": {"uart": {"kept_bytes": kept_bytes}}})
    assert closed == [pytest.approx(seconds, abs=0.02)]


def test_uart_sensor_fastest_stream_loses_nothing() -> None:
    async def script(served: Served) -> None:
        await served.sensor.ready()
        await served.clock.sleep_until(served.clock.now() + 3.0)
        gaps = [b.at - a.at for a, b in zip(served.frames, served.frames[1:], strict=False)]
        assert statistics.fmean(gaps) == pytest.approx(1.563e-3, rel=1e-3)

    kinder = {"jr3": {"uart": {"period_overhead_us": (0.0, 0.0)}}}
    assert with_cell(script, sensor={"jr3": {"uart": {"period_ms": 1.563}}}, cell=kinder).sensor.lost == 0


def test_uart_sensor_without_filter_is_noted_once() -> None:
    async def script(served: Served) -> None:
        await served.sensor.ready()
        await served.sensor.tare()

    served = with_cell(script, sensor={"jr3": {"uart": {"cutoff_hz": 0.0}}})
    (event,) = served.events
    assert event.kind == EventKind.SENSOR
    assert "filter is off (cut-off 0)" in event.text


def test_uart_sensor_unplugged_is_reported_in_one_line() -> None:
    async def script(served: Served) -> None:
        with pytest.raises(
            DeviceError, match=r"acknowledges but is not ready after 12 s; sensor unplugged\?"
        ):
            await served.sensor.ready()

    with_cell(script, cell={"jr3": {"sensor": {"connected": False}}})


@pytest.mark.parametrize("kept_bytes", [0, 256])
def test_uart_sensor_run_holds_ten_newtons(kept_bytes: int) -> None:
    sections: dict[str, Any] = {
        "run": {"duration_s": 10.0},
        "cell": {"jr3": {"uart": {"kept_bytes": kept_bytes}}},
    }

    async def script(served: Served) -> None:
        assert (await served.run()).outcome is Outcome.COMPLETED

    served = with_cell(script, **sections)
    steady = [record.force for record in served.cycles if record.phase == "track"][-20:]
    assert statistics.fmean(steady) == pytest.approx(10.0, abs=0.5)
    assert served.sensor.lost == 0
