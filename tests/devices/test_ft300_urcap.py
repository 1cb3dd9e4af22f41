"""The port of an emulated URCap: number of clients, URLs, and its use in a run and a probe."""

import asyncio
from typing import Any

import pytest

from hil_bridge.clock import Clock, run_real, run_virtual
from hil_bridge.devices.device_log import NullLog
from hil_bridge.devices.kinds import SENSORS, default_settings
from hil_bridge.devices.wiring import Wiring
from hil_bridge.errors import ConfigError, DeviceError
from hil_bridge.runs.compose import connect_sensor, emulated_cell
from hil_bridge.runs.setup import Listen, Setup
from hil_bridge.settings.configuration import read_config
from hil_bridge.site.sensor_probe import Screen, Session, probe
from hil_bridge.transports.opening import connect_bytes
from protocol.devices.ft300.urcap import TextReader, split_texts

MEMORY = "ft300-urcap+memory:urcap"


class Listener:
    """Client that stores all received data."""

    def __init__(self, wire: Any) -> None:
        self.raw = b""
        self.aclose = wire.aclose
        wire.start(self._hear, lambda error: None)

    def _hear(self, data: bytes) -> None:
        self.raw += data

    def take(self) -> list[bytes]:
        """Return the texts since the last call."""
        raw, self.raw = self.raw, b""
        return split_texts(raw)


def config_of(**urcap: Any) -> Any:
    return read_config({"sensor": {"emulated": "ft300-urcap"}, "cell": {"ft300": {"boot_s": 0.0, **urcap}}})


async def two_clients(clients: int, port: str) -> list[int]:
    """Return texts of two clients in half a second, and of the second after the first has left."""
    clock, counts = Clock.running(), []
    async with emulated_cell(
        Setup(config_of(urcap_clients=clients), Listen(None, port)), clock, print
    ) as served:
        assert served.sensor is not None
        first = Listener(await connect_bytes(served.sensor.url, clock))
        second = Listener(await connect_bytes(served.sensor.url, clock))
        await asyncio.sleep(0.5)
        before, waiting = first.take(), second.take()
        assert set(waiting) <= set(before)
        await first.aclose()
        await asyncio.sleep(0.5)
        after = second.take()
        assert len(TextReader().feed(b"".join(after))) == len(after)
        counts += [len(before), len(waiting), len(after)]
        await second.aclose()
    return counts


@pytest.mark.parametrize(("clients", "second_count"), [(1, 0), (2, 48)])
def test_urcap_limits_clients_and_lets_others_wait(clients: int, second_count: int) -> None:
    counts: list[int] = []

    async def main() -> None:
        counts.extend(await two_clients(clients, MEMORY))

    run_virtual(main)
    assert counts == [pytest.approx(48, abs=2), pytest.approx(second_count, abs=2), pytest.approx(49, abs=2)]


def test_urcap_serves_two_clients_over_tcp() -> None:
    counts: list[int] = []

    async def main() -> None:
        counts.extend(await two_clients(2, "ft300-urcap+tcp-listen://127.0.0.1:0"))

    run_real(main)
    assert min(counts) > 10


def test_second_client_fails_with_advice() -> None:
    async def main() -> None:
        clock = Clock.running()
        async with emulated_cell(Setup(config_of(), Listen(None, MEMORY)), clock, print) as served:
            assert served.sensor is not None
            first = Listener(await connect_bytes(served.sensor.url, clock))
            sensor = await connect_sensor(served.sensor, Wiring("sensor", clock, NullLog()))
            sensor.start()
            with pytest.raises(DeviceError, match="has sent nothing for 2 s") as failed:
                await sensor.ready()
            assert "it serves one at a time" in failed.value.remedy
            await sensor.aclose()
            await first.aclose()

    run_virtual(main)


def test_probe_of_urcap_shows_sensor() -> None:
    lines: list[str] = []

    async def main() -> None:
        clock, config = Clock.running(), config_of()
        async with emulated_cell(Setup(config, Listen(None, MEMORY)), clock, print):
            session = Session(Screen(lines.append, lines.append), None, 1.0)
            await probe(MEMORY, config, clock, session)

    run_virtual(main)
    rows = {line.split()[0]: line for line in lines}
    assert "99 frames per second" in rows["stream"]
    assert "Fz 300 N" in rows["full"]
    assert float(rows["wrench"].split("Fz ")[1].split()[0]) == pytest.approx(4.9, abs=0.3)


def parse(kind: str, url: str) -> str:
    room = SENSORS.kind(kind)
    return room.parse(url, default_settings(room)).text


def test_urcap_port_with_serial_kind_is_refused_with_hint() -> None:
    with pytest.raises(ConfigError, match=r"did you mean ft300-urcap\+tcp://10\.0\.0\.1:63351\?"):
        parse("ft300", "tcp://10.0.0.1:63351")
    assert parse("ft300-urcap", "tcp://10.0.0.1:63351") == "tcp://10.0.0.1:63351"
    assert parse("ft300-urcap", "tcp://10.0.0.1:1?reconnect_s=3") == "tcp://10.0.0.1:1?reconnect_s=3"
    with pytest.raises(ConfigError, match="unknown scheme 'serial'"):
        parse("ft300-urcap", "serial:///dev/ttyUSB0")
