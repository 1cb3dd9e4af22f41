"""The client of a sensor against gateways that misbehave, in virtual time; their answers are scripted."""

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
"""Answers to the questions for full scales: 115 111 185 N, 5.6 5.2 6.1 N·m."""

Script = Callable[[ForceSensor, Clock, Callable[[str], None]], Awaitable[None]]


def with_sensor(script: Script, answers: Mapping[str, str], default: str = "101#00") -> list[tuple[str, str]]:
    """Run a script with a sensor whose gateway answers frames as told; what the sensor told the record."""
    log = Notices()

    async def main() -> None:
        clock = Clock.running()
        bus = (await listen_can("can+memory:jr3", clock)).transport

        def say(text: str) -> None:
            if text:
                bus.send([parse_frame(text)])

        def heard(frames: Frames) -> None:
            for frame in frames:
                say(answers.get(str(frame), default))

        bus.start(heard, lambda cause: None)
        wire = await connect_can("can+memory:jr3", clock)
        sensor = ForceSensor(
            wire,
            GatewayClient(GatewayClientProfile(), clock.now()),
            clock,
            log,
        )
        sensor.start()
        try:
            await script(sensor, clock, say)
        finally:
            await sensor.aclose()
            await bus.aclose()

    run_virtual(main)
    return log.notices


def test_a_sensor_tells_its_full_scales_and_scales_counts_by_them() -> None:
    async def script(sensor: ForceSensor, clock: Clock, say: Callable[[str], None]) -> None:
        assert (await sensor.ready()).full_scales == (115.0, 111.0, 185.0, 5.6, 5.2, 6.1)
        say("601#0020000000C00100")
        say("681#0040000000000100")
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
def test_a_full_scale_of_zero_is_refused_by_name(question: str, answer: str, message: str) -> None:
    async def script(sensor: ForceSensor, clock: Clock, say: Callable[[str], None]) -> None:
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
        ("", "silent: nothing of a gateway on the bus in 10 s; power, bit rate, wiring? " + HANGS),
        ("102#00", "silent for 10 s while others are on the bus; wrong node number?"),
        ("101#01", "acknowledges but not ready after 10 s; sensor unplugged?"),
    ],
)
def test_a_gateway_that_does_not_come_up_says_what_to_look_at(default: str, message: str) -> None:
    async def script(sensor: ForceSensor, clock: Clock, say: Callable[[str], None]) -> None:
        began = clock.now()
        with pytest.raises(DeviceError) as caught:
            await sensor.ready()
        assert message in str(caught.value)
        assert clock.now() - began == pytest.approx(10.0, abs=0.01)

    with_sensor(script, {}, default)


def test_a_reboot_while_running_ends_the_sensor() -> None:
    async def script(sensor: ForceSensor, clock: Clock, say: Callable[[str], None]) -> None:
        await sensor.ready()
        say("701#")
        await clock.sleep_until(clock.now() + 0.01)
        with pytest.raises(DeviceError, match="restarted in mid-run; its zero is lost"):
            sensor.check()

    with_sensor(script, SCALES)


def test_closing_does_not_wait_for_a_gateway_that_is_gone() -> None:
    async def script(sensor: ForceSensor, clock: Clock, say: Callable[[str], None]) -> None:
        began = clock.now()
        await sensor.aclose()
        assert clock.now() - began < 1.0
        with pytest.raises(TransportClosed):
            sensor.check()

    assert with_sensor(script, {}, "") == []
