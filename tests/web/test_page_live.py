"""Page of a run in a real browser, its server with hostile clients, and Foxglove's protocol."""

import asyncio
import json
import os
import signal
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any

import aiohttp
import pytest

from hil_bridge.record import EventKind, read
from hil_bridge.record.scenes import SCENE_TOPICS
from hil_bridge.record.topics import TOPICS
from hil_bridge.show.charts.painter import y_range
from hil_bridge.show.pages import Chart, Limit
from hil_bridge.show.web.admission import TOKEN_HEADER
from tests.web.foxglove_client import foxglove
from tools.chromium import Page
from tools.web_run import WebRun

pytestmark = pytest.mark.live

FAULT = """
[[faults]]
on = "robot"
fault = "emergency-stop"
phase = "track"
after_s = {}
"""
NEAR = """
[cell]
start_position_mm = [900.0, -100.0, 591.0]
jr3.gateway.boot_s = 0.2
[task]
retract_mm = 1.0
"""
"""Short distance to the surface and back, and a sensor that responds quickly."""
LIMIT = "[limits]\nforce_limit_n = 15.0\n"
"""Limit close to the target force of 10 N."""
LONG = f"{NEAR}[run]\nduration_s = 60.0\n"
RETRACT = {"do": "retract and end"}
REPEATED = """(() => {
  const visible = [...document.querySelectorAll("p, dd, li span")].filter(one => one.offsetParent);
  const texts = visible.map(one => one.innerText.trim());
  return texts.filter((one, k) => one.split(" ").length > 4 && texts.indexOf(one) < k);
})()"""
"""Sentences that the page shows twice."""
GOOD = """(() => {
  const probe = document.createElement("i"), style = getComputedStyle(document.documentElement);
  document.body.append(probe);
  probe.style.color = style.getPropertyValue("--good");
  const good = getComputedStyle(probe).color;
  probe.remove();
  const visible = [...document.querySelectorAll("header *, #told *, #numbers *")].filter(one => one.offsetParent);
  const colours = one => [null, "::before"].flatMap(part => {
    const {color, backgroundColor} = getComputedStyle(one, part);
    return [color, backgroundColor];
  });
  return visible.filter(one => colours(one).includes(good)).map(one => one.id || one.className || one.tagName);
})()"""
"""Elements in the colour of a run that goes well."""
MB = 1 << 20


@asynccontextmanager
async def cuttable(port: int) -> AsyncIterator["CuttablePath"]:
    """Provide a connection to a loopback port that can be cut."""
    path = CuttablePath(port)
    await path.mend()
    try:
        yield path
    finally:
        await path.cut()


class CuttablePath:
    def __init__(self, port: int) -> None:
        self._to, self.port = port, 0
        self._server: asyncio.Server | None = None
        self._writers: list[asyncio.StreamWriter] = []

    async def mend(self) -> None:
        self._server = await asyncio.start_server(self._join, "127.0.0.1", self.port)
        self.port = self._server.sockets[0].getsockname()[1]

    async def cut(self) -> None:
        if self._server is not None:
            self._server.close()
        for writer in self._writers:
            writer.transport.abort()
        self._writers.clear()

    async def _join(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        there, back = await asyncio.open_connection("127.0.0.1", self._to)
        self._writers += [writer, back]
        await asyncio.gather(self._carry(reader, back), self._carry(there, writer))

    async def _carry(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with suppress(ConnectionError):
            while data := await reader.read(65536):
                writer.write(data)
                await writer.drain()
        writer.transport.abort()


def text(name: str) -> str:
    return f"document.getElementById('{name}')?.textContent"


async def test_browser_shows_run_cut_and_alarm(
    page: Page, web_run: Callable[..., WebRun], tmp_path: Path
) -> None:
    """Start, live data, limits, a cut and the recovery, an alarm after an injected fault, the end with its cause."""
    run = web_run(
        "--duration",
        "40",
        "--record",
        "run.mcap",
        config=NEAR + LIMIT + FAULT.format(12.0),
    )
    async with cuttable(run.port) as path:
        await page.open(f"http://127.0.0.1:{path.port}/")
        await page.until("window.hilPage && hilPage.charts.sources.cycle.x.length > 3")
        assert "EMULATED" in await page.value(text("cell"))
        assert await page.value("document.getElementById('end').hidden")  # no token, no button
        limits = "hilPage.charts.charts[0].spec.limits.map(one => one.value).join()"
        assert await page.value(limits) == "15,-10"
        chart = Chart("force", "", "N", limits=[Limit(15.0, ""), Limit(-10.0, "")], zero=True, least_span=2.0)
        for low, high in (
            (0.0, 0.1),
            (0.0, 7.4),
            (0.0, 7.6),
            (-4.0, 3.0),
            (-6.0, 3.0),
        ):  # pictures have the same rule
            output = await page.value(
                f"hilPage.charts.range({{...hilPage.charts.charts[0], first: false}}, {low}, {high})"
            )
            assert output == pytest.approx(y_range(chart, low, high))
            assert (output[1] > 15.0, output[0] < -10.0) == (high > 7.5, low < -5.0)
        await page.until(f"{text('phase')} === 'track'")
        await page.until("hilPage.cell.frames > 0 && hilPage.cell.placed && hilPage.cell.path")
        assert await page.value("hilPage.cell.model.piece.heights.length") > 3
        # the limit is a red line in the canvas: a row in which at least every second pixel is red
        red = """(() => { const u = hilPage.charts.charts[0].plot, y = Math.round(u.valToPos(15, 'y', true));
          const {left, width} = u.bbox, row = u.ctx.getImageData(left, y - 1, width, 3).data; let count = 0;
          for (let k = 0; k < row.length; k += 4) if (row[k] > 150 && row[k + 1] < 90 && row[k + 2] < 90) count++;
          return count > width / 3; })()"""
        await page.until(red)
        await path.cut()
        await page.until("!document.getElementById('cut').hidden")
        assert "old" in await page.value(text("cut"))
        assert await page.value(GOOD) == []
        await path.mend()
        await page.until(f"{text('link')} === 'live' && document.getElementById('cut').hidden")
        await page.until(
            "!document.getElementById('cause').hidden || !document.getElementById('outcome').hidden"
        )
        assert await page.value(GOOD) == []
        await page.until("document.querySelector('#list .alarm')")
        await page.until("!document.getElementById('outcome').hidden")
        outcome = (await page.value(text("outcome"))).replace("\u00a0", " ")
        await page.until("document.body.classList.contains('ended')")
        assert await page.value(text("phase")) == "stopped"
        assert "supervisor" not in await page.value("document.getElementById('motion').innerText")
        commands = "[...document.querySelectorAll('#next code')].map(one => one.textContent)"
        assert await page.value(commands) == ["hil-bridge why run.mcap", "hil-bridge report run.mcap"]
        assert await page.value(REPEATED) == []
        assert await page.value(GOOD) == []
        titles = "[...document.querySelectorAll('.hil-title')].map(one => one.textContent)"
        assert (await page.value(titles))[0].endswith("N · force limit 15 · pull limit −10")
    assert run.ended() == 3
    cause = read(tmp_path / "0" / "run.mcap").end["text"]
    assert cause
    assert "?" not in outcome, "the query of a URL is omitted"
    assert cause.partition(";")[0].lower() in outcome.lower()
    assert [one for one in page.errors if "ERR_CONNECTION" not in one and "WebSocket" not in one] == []


async def test_page_retracts_and_ends_run(page: Page, web_run: Callable[..., WebRun], tmp_path: Path) -> None:
    run = web_run("--record", "run.mcap", config=LONG)
    await page.open(run.url)
    await page.until(f"{text('phase')} === 'track'")
    assert "link" in await page.value(GOOD)
    await page.value("document.getElementById('end').click()")
    await page.until("document.getElementById('sure').open")
    await page.value("document.querySelector('#sure .danger').click()")
    await page.until(f"{text('phase')} === 'retract' || !document.getElementById('outcome').hidden")
    assert await page.value(GOOD) == []
    await page.until("!document.getElementById('outcome').hidden")
    await page.until(f"{text('phase')} === 'ended by the operator'")
    assert run.ended() == 130
    recording = read(tmp_path / "0" / "run.mcap")
    assert recording.end["outcome"] == "interrupted"
    assert recording.end["left"].startswith("retracted")
    assert any("on the page in the browser" in event.text for event in recording.events)
    await asyncio.sleep(1.0)  # a second attempt to connect would have failed by now
    assert await page.value("document.getElementById('cut').hidden")
    assert page.errors == []


def resident_bytes(process: int) -> int:
    """Return the memory use of a process, bytes."""
    return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


async def status(session: aiohttp.ClientSession, url: str, method: str = "GET", **options: Any) -> int:
    async with session.request(method, url, **options) as answer:
        return answer.status


async def test_foxglove_receives_every_record(web_run: Callable[..., WebRun], tmp_path: Path) -> None:
    run = web_run("--record", "run.mcap", "--duration", "3", config=NEAR)
    async with aiohttp.ClientSession() as session:
        result = await foxglove(session, run, 60.0)
    assert run.ended() == 0
    assert result["serverInfo"]["capabilities"] == []  # nothing can be written
    json_channels = {name for name, one in result["channels"].items() if one["encoding"] == "json"}
    assert json_channels == {topic.name for topic in (*TOPICS, *SCENE_TOPICS)}
    for topic in (*TOPICS, *SCENE_TOPICS):
        channel = result["channels"][topic.name]
        assert channel["schemaName"] == topic.schema_name
        assert json.loads(channel["schema"]) == json.loads(json.dumps(topic.schema))
    recording = read(tmp_path / "0" / "run.mcap")
    cycles = [message["cycle"] for _, message in result["messages"]["/cycle"]]
    assert cycles == list(range(cycles[0], recording.cycles[-1].cycle + 1))
    forces = {cycle.cycle: cycle.force for cycle in recording.cycles}
    assert all(forces[message["cycle"]] == message["force"] for _, message in result["messages"]["/cycle"])
    sequences = [message["sequence"] for _, message in result["messages"]["/sensor"]]
    recorded = [frame.sequence for frame in recording.sensors]
    assert sequences == recorded[recorded.index(sequences[0]) :]
    assert result["messages"]["/scene/tool"]


async def test_hostile_clients_are_refused_or_dropped(web_run: Callable[..., WebRun], tmp_path: Path) -> None:
    """Other hosts and origins, wrong tokens, giant frames, floods and a client that reads nothing.

    None affects the run, and none costs memory.
    """
    run = web_run("--record", "run.mcap", config=LONG)
    end, live = f"{run.origin}/end", f"{run.origin}/live"
    evil = {"Origin": "http://evil.example"}
    async with aiohttp.ClientSession() as session:
        assert await status(session, run.origin) == 200
        before = resident_bytes(run.server())
        assert await status(session, run.origin, headers={"Host": "evil.example"}) == 403
        assert await status(session, run.origin, headers=evil) == 403
        assert (
            await status(session, run.origin, headers={"Sec-Fetch-Site": "cross-site"}) == 403
        )  # as a picture
        assert await status(session, f"{run.origin}/static/..%2f__init__.py") == 404
        for path in ("/live", "/"):
            with pytest.raises(aiohttp.WSServerHandshakeError, match="403"):
                await session.ws_connect(run.origin + path, protocols=("foxglove.sdk.v1",), headers=evil)
        with pytest.raises(aiohttp.WSServerHandshakeError, match="400"):
            await session.ws_connect(f"{run.origin}/", protocols=("other",))
        good = {TOKEN_HEADER: run.token}
        assert await status(session, end, headers=good) == 405  # never by GET
        assert await status(session, end, "POST", json=RETRACT, headers={TOKEN_HEADER: "guess"}) == 403
        assert await status(session, end, "POST", json=RETRACT, headers=good | evil) == 403
        assert await status(session, end, "POST", data=json.dumps(RETRACT), headers=good) == 415
        guesses = [
            await status(session, end, "POST", json=RETRACT, headers={TOKEN_HEADER: "x"}) for _ in range(6)
        ]
        assert guesses[-1] == 429
        for path, protocols in (("/live", ()), ("/", ("foxglove.sdk.v1",))):
            async with session.ws_connect(run.origin + path, protocols=protocols) as giant:
                with suppress(ConnectionError):
                    await giant.send_str("x" * (4 * MB))
                assert await close_code(giant) in (aiohttp.WSCloseCode.MESSAGE_TOO_BIG, 1006, None)
            async with session.ws_connect(run.origin + path, protocols=protocols) as flood:
                with suppress(ConnectionError):
                    for _ in range(1000):
                        await flood.send_str('{"op": "subscribe", "subscriptions": []}')
                assert await close_code(flood) in (1008, 1003, 1006, None)
        async with session.ws_connect(live) as nonsense:
            await nonsense.send_str("[" * 10_000)
            assert await close_code(nonsense) == aiohttp.WSCloseCode.UNSUPPORTED_DATA
        deaf = [await open_silent(run.port, path) for path in ("/live", "/", "/live", "/live")]
        idle = [await asyncio.open_connection("127.0.0.1", run.port) for _ in range(100)]
        crowd: list[Any] = []
        with suppress(aiohttp.WSServerHandshakeError, ConnectionError, aiohttp.ClientError):
            while len(crowd) < 20:
                crowd += [await session.ws_connect(live)]
        assert len(crowd) < 16
        for _, writer in (*deaf, *idle):
            writer.transport.abort()
        for socket in crowd:
            await socket.close()
        await asyncio.sleep(0.5)
        assert resident_bytes(run.server()) - before < 40 * MB
        await wait_until_tracking(session, live)  # a run that has not moved leaves no record of a movement
        assert await status(session, end, "POST", json=RETRACT, headers=good) == 200
    assert run.ended() == 130
    recording = read(tmp_path / "0" / "run.mcap")
    assert recording.end["outcome"] == "interrupted"
    assert not [event for event in recording.events if event.kind == EventKind.STOP]


async def wait_until_tracking(session: aiohttp.ClientSession, live: str) -> None:
    """Wait until the page shows that the tool tracks the surface."""
    async with asyncio.timeout(60.0), session.ws_connect(live) as socket:
        async for message in socket:
            if json.loads(message.data)["now"]["phase"] == "track":
                return
    raise AssertionError("the page never reported that the tool tracks")


async def close_code(socket: aiohttp.ClientWebSocketResponse) -> int | None:
    """Return the code with which the server closed a WebSocket, after its previous messages."""
    async with asyncio.timeout(20.0):
        with suppress(ConnectionError):
            async for _ in socket:
                pass
    return socket.close_code


async def open_silent(port: int, path: str) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    """Return a WebSocket whose client reads nothing."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=1)
    writer.write(
        f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n"
        "Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n".encode()
    )
    return reader, writer


def test_server_ends_with_run_but_run_survives_server(web_run: Callable[..., WebRun], tmp_path: Path) -> None:
    killed, robbed = web_run(config=LONG), web_run("--record", "run.mcap", "--duration", "1", config=NEAR)
    server = killed.server()
    os.kill(robbed.server(), signal.SIGKILL)
    killed.process.send_signal(signal.SIGKILL)
    killed.process.wait()
    until = time.monotonic() + 15
    while Path(f"/proc/{server}").exists() and time.monotonic() < until:
        if Path(f"/proc/{server}/stat").read_text().rpartition(")")[2].split()[0] == "Z":
            break
        time.sleep(0.05)
    else:
        assert not Path(f"/proc/{server}").exists()
    assert robbed.ended() == 0
    events = read(tmp_path / "1" / "run.mcap").events
    assert [event.text for event in events if event.kind == EventKind.WEB] == [
        "the page's server has ended; the run continues"
    ]
