"""Sensor client with misbehaving gateways whose answers are scripted, in virtual time."""

from collections.abc import Awaitable, Callable, Mapping

import pytest

from hil_bridge.clock import Clock, run_virtual
from hil_bridge.devices.sensors.stream import ForceSensor
from hil_bridge.errors import DeviceError, TransportClosed
from hil_bridge.transports import Frames, connect_can, listen_can
from protocol.devices.jr3 import GatewayClient, GatewayClientProfile, parse_frame
from protocol.devices.jr3.firmware import HANGS
from tests.runs.kept_notices import Notices

SCALES = {"481#": "101#0073006F00B900", "501#": "101#00380034003D00"}
"""Answers to requests for full scales: 115 111 185 N, 5.6 5.2 6.1 N·m."""

Script = Callable[[ForceSensor, Clock, Callable[[str], None]], Awaitable[None]]


def with_sensor(script: Script, answers: Mapping[str, str], default: str = "101#00") -> list[tuple[str, str]]:
    """Run a script with a sensor whose gateway has these answers; return the recorded notices."""
    log = Notices()

    async def main() -> None:
        clock = Clock.running()
        bus = (await listen_can("can+memory:jr3", clock)).transport

        def send_frame(text: str) -> None:
            if text:
                bus.send([parse_frame(text)])

        def answer_frames(frames: Frames) -> None:
            for frame in frames:
                send_frame(answers.get(str(frame), default))

        bus.start(answer_frames, lambda cause: None)
        wire = await connect_can("can+memory:jr3", clock)
        sensor = ForceSensor(
            wire,
            GatewayClient(GatewayClientProfile(), clock.now()),
            clock,
            log,
        )
        sensor.start()
        try:
            await script(sensor, clock, send_frame)
        finally:
            await sensor.aclose()
            await bus.aclose()

    run_virtual(main)
    return log.notices


def test_gateway_sensor_scales_counts_by_full_scales() -> None:
    async def script(sensor: ForceSensor, clock: Clock, send_frame: Callable[[str], None]) -> None:
        assert (await sensor.ready()).full_scales == (115.0, 111.0, 185.0, 5.6, 5.2, 6.1)
        send_frame("601#0020000000C00100")
        send_frame("681#0040000000000100")
        await clock.sleep_until(clock.now() + 0.01)
        assert sensor.newest is not None
        assert sensor.wrench(sensor.newest) == (57.5, 0.0, -185.0, 5.6, 0.0, 0.0)
        assert (sensor.received, sensor.lost) == (1, 0)

    assert with_sensor(script, SCALES) == []


@pytest.mark.parametrize(
    ("question", "answer", "message"),
    [
        ("481#", "101#00730000000000", "full scale of fy is 0; calibration not read?"),
        ("501#", "101#00000034003D00", "full scale of mx is 0; calibration not read?"),
    ],
)
def test_gateway_sensor_zero_full_scale_is_refused(question: str, answer: str, message: str) -> None:
    async def script(sensor: ForceSensor, clock: Clock, send_frame: Callable[[str], None]) -> None:
        with pytest.raises(DeviceError, match="force sensor on ") as caught:
            await sensor.ready()
        assert f"force sensor on can+memory:jr3: gateway node 1: {message}" == str(caught.value)
        with pytest.raises(DeviceError):
            sensor.check()

    ((kind, text),) = with_sensor(script, SCALES | {question: answer})
    assert kind == "sensor"
    assert message in text


@pytest.mark.parametrize(
    ("default", "message"),
    [
        ("", "silent: no frame of a gateway on the bus for 10 s; power, bit rate, wiring? " + HANGS),
        ("102#00", "silent for 10 s while other nodes are on the bus; wrong node number?"),
        ("101#01", "acknowledges but is not ready after 10 s; sensor unplugged?"),
    ],
)
def test_gateway_sensor_silent_reports_remedy(default: str, message: str) -> None:
    async def script(sensor: ForceSensor, clock: Clock, send_frame: Callable[[str], None]) -> None:
        began = clock.now()
        with pytest.raises(DeviceError) as caught:
            await sensor.ready()
        assert message in str(caught.value)
        assert clock.now() - began == pytest.approx(10.0, abs=0.01)

    with_sensor(script, {}, default)


def test_gateway_sensor_reboot_ends_stream() -> None:
    async def script(sensor: ForceSensor, clock: Clock, send_frame: Callable[[str], None]) -> None:
        await sensor.ready()
        send_frame("701#")
        await clock.sleep_until(clock.now() + 0.01)
        with pytest.raises(DeviceError, match="restarted in mid-run; its zero is lost"):
            sensor.check()

    with_sensor(script, SCALES)


def test_gateway_sensor_close_ignores_lost_gateway() -> None:
    async def script(sensor: ForceSensor, clock: Clock, send_frame: Callable[[str], None]) -> None:
        began = clock.now()
        await sensor.aclose()
        assert clock.now() - began < 1.0
        with pytest.raises(TransportClosed):
            sensor.check()

    assert with_sensor(script, {}, "") == []
