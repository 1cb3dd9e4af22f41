"""Tests of sensors other than a JR3 over real wires: UDP with HTTP, a pseudo-terminal, an slcan adapter."""

import asyncio
import socket
from typing import Any

import pytest

from hil_bridge.clock import Clock, run_real
from hil_bridge.devices.device_log import NullLog
from hil_bridge.devices.sensors.stream import ForceSensor
from hil_bridge.devices.wiring import Wiring
from hil_bridge.runs.compose import connect_sensor, emulated_cell
from hil_bridge.runs.setup import Listen, Setup
from hil_bridge.settings.configuration import read_config
from hil_bridge.settings.devices import sensor_at
from protocol.devices.netft import Command, encode_request

pytestmark = pytest.mark.live

CASES = (
    ("netft", "netft+udp-bind://127.0.0.1:0", {"netft": {"boot_s": 0.3}}, 250),
    ("netft", "netft+udp-bind://127.0.0.1:0", {"netft": {"boot_s": 0.0, "rate_hz": 7000}}, 1500),
    ("ft300", "ft300+pty:", {"ft300": {"boot_s": 0.0}}, 30),
    ("ft300", "ft300+tcp-listen://127.0.0.1:0", {"ft300": {"boot_s": 0.0, "power_up": "stream"}}, 30),
    ("ft300-urcap", "ft300-urcap+tcp-listen://127.0.0.1:0", {"ft300": {"boot_s": 0.0}}, 30),
    ("ati-can", "ati-can+can+slcan+pty:", {"ati_can": {"boot_s": 0.2}}, 30),
)


@pytest.mark.parametrize(("kind", "port", "cell", "least"), CASES)
def test_sensor_streams_over_wire_and_can_be_zeroed(
    kind: str, port: str, cell: dict[str, Any], least: int
) -> None:
    """Half a second of its stream: the weight of the tool before the zero, and zero after it."""
    reported: list[ForceSensor] = []
    forces: list[float] = []

    async def main() -> None:
        clock = Clock.running()
        config = read_config({"sensor": {"emulated": kind}, "cell": cell})
        try:
            async with emulated_cell(Setup(config, Listen(None, port)), clock, lambda cause: None) as served:
                assert served.sensor is not None
                sensor = await connect_sensor(served.sensor, Wiring("sensor", clock, NullLog()))
                sensor.start()
                await sensor.ready()
                reported.append(sensor)
                forces.append(sensor.wrench(await sensor.frame())[2])
                await sensor.tare()
                before = sensor.received
                await asyncio.sleep(0.5)
                sensor.check()
                forces.append(sensor.wrench(await sensor.frame())[2])
                reported.append(sensor)
                assert sensor.received - before >= least
                await sensor.aclose()
        finally:
            clock.close()

    run_real(main)
    assert reported[0].saturated == ()
    assert forces == [pytest.approx(4.9, abs=0.6), pytest.approx(0.0, abs=0.6)]


def test_web_page_survives_invalid_requests() -> None:
    answers: list[bytes] = []

    async def main() -> None:
        clock = Clock.running()
        config = read_config({"sensor": {"emulated": "netft"}, "cell": {"netft": {"boot_s": 0.0}}})
        port = "netft+udp-bind://127.0.0.1:0?http_port=0"
        try:
            async with emulated_cell(Setup(config, Listen(None, port)), clock, lambda cause: None) as served:
                assert served.sensor is not None
                page = int(served.sensor.url.rpartition("=")[2])
                silent = [await asyncio.open_connection("127.0.0.1", page) for _ in range(12)]
                for text in (b"\xff\x00\r\n\r\n", b"POST / HTTP/1.1\r\n\r\n", b"x" * 20_000):
                    for _, writer in silent:
                        writer.close()
                    silent = []
                    await asyncio.sleep(0.05)
                    reader, writer = await asyncio.open_connection("127.0.0.1", page)
                    writer.write(text)
                    answers.append(await reader.read())
                    writer.close()
                reader, writer = await asyncio.open_connection("127.0.0.1", page)
                writer.write(b"GET /netftapi2.xml HTTP/1.1\r\nHost: x\r\n\r\n")
                answers.append(await reader.read())
                writer.close()
        finally:
            clock.close()

    run_real(main)
    assert all(answer.startswith(b"HTTP/1.1 400") for answer in answers[:3])
    assert b"<cfgcpf>1000000</cfgcpf>" in answers[3]


def test_page_without_server_is_reported() -> None:
    messages: list[str] = []

    async def main() -> None:
        clock = Clock.running()
        config = read_config({"sensor": {"netft": {"page_patience_s": 0.6}}})
        try:
            url = "netft+udp://127.0.0.1:9?http_port=9"
            sensor = await connect_sensor(sensor_at(config, url), Wiring("sensor", clock, NullLog()))
            sensor.start()
            try:
                await sensor.ready()
            except Exception as error:
                messages.append(str(error))
            await sensor.aclose()
        finally:
            clock.close()

    run_real(main)
    (reported,) = messages
    assert "its configuration page was not received within 0.6 s" in reported
    assert "\n" not in reported


def test_starting_client_gets_records_and_biasing_does_not() -> None:
    """Three programs at one box, each with its own socket."""
    counts: list[int] = []

    async def main() -> None:
        clock = Clock.running()
        config = read_config({"sensor": {"emulated": "netft"}, "cell": {"netft": {"boot_s": 0.0}}})
        mine, other = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        try:
            port = "netft+udp-bind://127.0.0.1:0"
            async with emulated_cell(Setup(config, Listen(None, port)), clock, lambda cause: None) as served:
                assert served.sensor is not None
                there = int(served.sensor.url.partition("?")[0].rpartition(":")[2])
                for end in (mine, other):
                    end.setblocking(False)
                    end.connect(("127.0.0.1", there))
                for end, command in ((mine, Command.START), (other, Command.BIAS), (other, Command.START)):
                    end.send(encode_request(command))
                    await asyncio.sleep(0.2)
                    counts.extend((drained(mine), drained(other)))
        finally:
            mine.close()
            other.close()
            clock.close()

    run_real(main)
    assert [count > 50 for count in counts] == [True, False, True, False, False, True]
    assert (counts[1], counts[3]) == (0, 0)


def drained(end: socket.socket) -> int:
    """Return the datagrams received so far."""
    count = 0
    while True:
        try:
            end.recv(2048)
        except BlockingIOError:
            return count
        count += 1
