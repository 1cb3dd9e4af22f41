"""Tests of the register server on TCP, and of a board served by one process to another."""

import asyncio
import signal
import socket
import subprocess
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress
from pathlib import Path

import pytest

from hil_bridge.clock import Clock, run_real
from hil_bridge.devices.sensors.jr3.registers import ListenerProfile, Watcher, serve_board
from hil_bridge.errors import TransportUnavailable
from protocol.devices.jr3.board import check_range, pack_words
from protocol.devices.jr3.registers import (
    Garbage,
    Op,
    RegisterServerProfile,
    Request,
    Response,
    Status,
    encode_request,
    response_reader,
)
from protocol.endpoint import RemoteProtocolError
from tests.live.processes import PATIENCE_S, start

pytestmark = pytest.mark.live


class Memory:
    """Board of plain words; the serial number is 1."""

    def __init__(self) -> None:
        self.words = [0] * 0x4000
        self.words[0xF8] = 1

    def read(self, address: int, count: int, now: float) -> tuple[int, ...]:
        check_range(address, count)
        return tuple(self.words[address : address + count])

    def load(self, address: int, words: Sequence[int], now: float) -> None:
        raise RemoteProtocolError("this board takes no program")

    def burst(self, address: int, count: int, now: float) -> bytes:
        return pack_words(self.read(address, count, now))

    def write(self, address: int, words: Sequence[int], now: float) -> None:
        check_range(address, len(words))
        self.words[address : address + len(words)] = words

    def reset(self, now: float) -> None:
        self.words = [0] * 0x4000


class Client:
    """Socket that sends the given register protocol data, valid or not."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.reader, self.writer = reader, writer
        self._telegrams = response_reader()
        self._responses: list[Response | Garbage] = []

    def send(self, *requests: Request) -> None:
        self.writer.write(b"".join(map(encode_request, requests)))

    async def response(self) -> Response | None:
        """Return the next response, or None at the end of the connection."""
        while not self._responses:
            data = await self.reader.read(65536)
            if not data:
                return None
            self._responses += self._telegrams.feed(data)
        response = self._responses.pop(0)
        assert isinstance(response, Response)
        return response

    async def aclose(self) -> None:
        self.writer.close()
        with suppress(ConnectionError):
            await self.writer.wait_closed()


Connect = Callable[[], Awaitable[Client]]


def on_tcp(
    test: Callable[[Connect, list[str]], Awaitable[None]], profile: ListenerProfile | None = None
) -> None:
    """Serve a board on loopback for a test; it must close cleanly afterwards."""

    async def main() -> None:
        clock, logged, clients = Clock.running(), list[str](), list[Client]()
        served = await serve_board(
            "tcp-listen://127.0.0.1:0",
            Memory(),
            profile or ListenerProfile(),
            clock,
            Watcher(logged.append, lambda cause: None),
        )
        port = int(served.address.rpartition(":")[2])

        async def connect() -> Client:
            clients.append(Client(*await asyncio.open_connection("127.0.0.1", port)))
            return clients[-1]

        try:
            async with asyncio.timeout(PATIENCE_S):
                await test(connect, logged)
        finally:
            await served.aclose()
            for client in clients:
                await client.aclose()
            clock.close()

    run_real(main)


SERIAL = Request(Op.READ, 1, 0xF8, 1)


async def serves(client: Client) -> bool:
    client.send(SERIAL)
    response = await client.response()
    return response is not None and response.bursts[0].words == (1,)


def test_eight_of_ten_clients_are_served() -> None:
    async def test(connect: Connect, logged: list[str]) -> None:
        clients = []
        for _ in range(8):
            clients.append(await connect())
            assert await serves(clients[-1])
        for _ in range(2):
            late = await connect()
            response = await late.response()
            assert response is not None
            assert (response.op, response.status) == (Op.CONNECTION, Status.TOO_MANY_CLIENTS)
            assert await late.response() is None
        assert len(logged) == 1  # one line for both
        assert "rejected, 8 clients are connected" in logged[0]
        await clients[0].aclose()
        while not await serves(clients[1]):
            pass
        assert await serves(await connect())
        assert await (await connect()).response() is not None
        assert len(logged) == 2  # full once more

    on_tcp(test)


def test_idle_new_clients_make_room_for_next() -> None:
    async def test(connect: Connect, logged: list[str]) -> None:
        silent = [await connect() for _ in range(8)]
        assert await serves(await connect())
        response = await silent[0].response()
        assert response is not None
        assert (response.op, response.status) == (Op.CONNECTION, Status.TOO_MANY_CLIENTS)
        assert await silent[0].response() is None
        assert await serves(silent[1])
        assert logged == [text for text in logged if "had not sent anything" in text]
        assert len(logged) == 1

    on_tcp(test)


def test_idle_clients_are_dropped_but_not_streams() -> None:
    async def test(connect: Connect, logged: list[str]) -> None:
        idle, streaming = await connect(), await connect()
        streaming.send(Request(Op.STREAM, 7, 0, 1, period_us=20_000))
        last_response = await idle.response()
        assert last_response is not None
        assert last_response.status is Status.IDLE
        assert await idle.response() is None
        for _ in range(5):
            response = await streaming.response()
            assert response is not None
            assert response.op == Op.STREAM
        assert len(logged) == 1

    on_tcp(test, ListenerProfile(connection=RegisterServerProfile(idle_timeout_s=0.1)))


@pytest.mark.parametrize(
    "data",
    [b"GET / HTTP/1.1\r\nHost: board\r\n\r\n", b"\x16\x03\x01" + bytes(300), b"JR\x02" + b"\xff" * 4000],
)
def test_invalid_frame_closes_client_connection(data: bytes) -> None:
    async def test(connect: Connect, logged: list[str]) -> None:
        stranger, friend = await connect(), await connect()
        stranger.writer.write(data)
        response = await stranger.response()
        assert response is not None
        assert response.status is Status.BAD_FRAME
        assert await stranger.response() is None
        assert len(logged) == 1
        assert "\n" not in logged[0]
        assert await serves(friend)

    on_tcp(test)


def test_incomplete_request_and_early_end_are_cleaned_up() -> None:
    async def test(connect: Connect, logged: list[str]) -> None:
        for _ in range(20):
            client = await connect()
            client.writer.write(encode_request(SERIAL)[:9])
            await client.writer.drain()
            await client.aclose()
        assert await serves(await connect())
        assert logged == []

    on_tcp(test)


def test_unread_flood_stalls_without_blocking_others() -> None:
    async def test(connect: Connect, logged: list[str]) -> None:
        flood, friend = await connect(), await connect()
        telegrams = encode_request(Request(Op.READ, 1, 0, 256)) * 5000
        flood.writer.transport.set_write_buffer_limits(high=1)
        sent = 0
        with suppress(TimeoutError):
            while sent < 1e8:
                flood.writer.write(telegrams)
                sent += len(telegrams)
                async with asyncio.timeout(0.3):
                    await flood.writer.drain()
        assert sent < 1e8
        assert await serves(friend)
        assert logged == []
        flood.writer.transport.abort()

    on_tcp(test)


def test_unread_stream_is_closed() -> None:
    async def test(connect: Connect, logged: list[str]) -> None:
        slow, friend = await connect(), await connect()
        connection: socket.socket = slow.writer.get_extra_info("socket")
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        slow.reader._limit = 1  # type: ignore[attr-defined]
        slow.send(Request(Op.STREAM, 1, 0, 256, period_us=250))
        while not logged:
            assert await serves(friend)
        assert "disconnected: it does not read" in logged[0]

    on_tcp(test)


def test_busy_port_is_reported() -> None:
    async def main() -> None:
        clock = Clock.running()
        with socket.create_server(("127.0.0.1", 0)) as busy:
            url = f"tcp-listen://127.0.0.1:{busy.getsockname()[1]}"
            try:
                await serve_board(url, Memory(), ListenerProfile(), clock, Watcher(print, print))
            finally:
                clock.close()

    with pytest.raises(TransportUnavailable, match="another program already listens on this port"):
        run_real(main)


# --- processes


def stop(process: "subprocess.Popen[str]") -> tuple[int, str, str]:
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=PATIENCE_S)
    return process.returncode, output, errors


def test_pci_board_is_served_to_other_process(tmp_path: Path) -> None:
    folder = tmp_path / "0000:03:00.0"
    folder.mkdir()
    (folder / "vendor").write_text("0x1762\n")
    (folder / "device").write_text("0x3111\n")
    memory = bytearray(0x80000)
    for place, letter in enumerate(b"Copyright JR3"):
        memory[0x10000 + 4 * (0x40 + place) + 1] = letter
    memory[0x10000 + 4 * 0xF8] = 1
    (folder / "resource0").write_bytes(memory)
    server = start(
        "emulate",
        "jr3-pci",
        "--pci",
        "03:00.0",
        "--listen",
        "127.0.0.1:0",
        "--offset",
        "0x10000",
        "--sysfs",
        str(tmp_path),
    )
    try:
        assert server.stdout is not None
        assert server.stdout.readline() == "board: Copyright JR3\n"
        url = server.stdout.readline().strip()
        assert url.startswith("sensor: jr3-board+tcp://127.0.0.1:")
        assert server.stdout.readline() == "Stop with Ctrl-C.\n"
        with socket.create_connection(("127.0.0.1", int(url.rpartition(":")[2])), PATIENCE_S) as client:
            client.sendall(encode_request(Request(Op.WRITE, 2, 0x80, 1, (400,))) + encode_request(SERIAL))
            result: list[Response | Garbage] = []
            reader = response_reader()
            while len(result) < 2:
                result += reader.feed(client.recv(4096))
        assert [response.status for response in result if isinstance(response, Response)] == [Status.OK] * 2
        assert isinstance(result[1], Response)
        assert result[1].bursts[0].words == (1,)
        assert stop(server) == (0, "", "")
    finally:
        server.kill()
        server.communicate()
    assert (folder / "resource0").read_bytes()[0x10000 + 4 * 0x80 :][:4] == (400).to_bytes(4, "little")
