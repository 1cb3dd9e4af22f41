"""Panel of an emulated robot on a page: what the run receives, what the server refuses, and browser operation."""

import asyncio
import json
import socket
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import aiohttp
import pytest

from hil_bridge.devices.panel import LocalPanel
from hil_bridge.show.web import wire
from hil_bridge.show.web.admission import TOKEN_HEADER, Admission
from hil_bridge.show.web.panel_updates import PanelUpdates
from hil_bridge.show.web.run_source import Cursor
from hil_bridge.show.web.server import Server
from tests.web.test_feed import Ends, ends, pause
from tests.web.test_idle import Nothing
from tools.chromium import Page
from tools.web_run import Serving, WebRun

__all__ = ["ends"]
TOKEN = "the-token-of-this-run"
PRESS = {"do": "emergency-stop", "to": "press"}


class Lever:
    """Panel with one lever."""

    def __init__(self) -> None:
        self.at, self.requests = "up", list[Mapping[str, Any]]()

    def perform(self, request: Mapping[str, Any]) -> Mapping[str, Any]:
        match request:
            case {"do": "controls"}:
                return {"controls": {"lever": {"meaning": "A lever.", "to": ["up", "down"], "usual": ""}}}
            case {"do": "faults"}:
                return {"faults": {}}
            case {"do": "show"}:
                return {"rows": {"lever": self.at}, "at": {"lever": self.at}, "state": {}}
            case {"do": "lever", "to": "up" | "down"}:
                self.requests.append(request)
                self.at = request["to"]
                return self.perform({"do": "show"})
        raise ValueError(f"unknown action {request.get('do')!r}")

    @property
    def operated(self) -> LocalPanel:
        return LocalPanel("toy", self.perform)


# --- the process of the robot


async def test_panel_request_is_executed_and_answered(ends: Ends) -> None:
    lever = Lever()
    ends.listen()
    ends.feed.offer(lever.operated)
    assert [type(one) for one in ends.decoded_messages()] == [wire.Panel, wire.PanelState]
    ends.feed.show_panel()
    assert ends.decoded_messages() == [], "nothing has changed"
    ends.other.send(wire.encode_message(wire.PanelRequest(7, {"do": "lever", "to": "down"})))
    await pause()
    assert ends.decoded_messages() == [
        wire.PanelState({"lever": "down"}, {"lever": "down"}),
        wire.PanelResponse(7, ""),
    ]
    ends.other.send(wire.encode_message(wire.PanelRequest(8, {"do": "dance"})))
    await pause()
    assert ends.decoded_messages() == [wire.PanelResponse(8, "unknown action 'dance'")]
    lever.at = "up"
    ends.feed.show_panel()
    assert ends.decoded_messages() == [wire.PanelState({"lever": "up"}, {"lever": "up"})]


async def test_feed_without_panel_ignores_requests(ends: Ends) -> None:
    ends.listen()
    requested = wire.encode_message(wire.PanelRequest(1, {"do": "lever", "to": "down"}))
    ends.other.send(requested)
    await pause()
    assert ends.decoded_messages() == []
    lever = Lever()
    ends.feed.offer(lever.operated)
    for data in (requested[:-3], b"\xff" * 40, wire.encode_message(wire.PanelResponse(1, ""))):
        ends.other.send(data)
    await pause()
    assert (lever.requests, ends.gone, ends.retracted) == ([], [], [])


def test_page_receives_panel_once_and_state_changes() -> None:
    updates, early, late = PanelUpdates(), Cursor(), Cursor()
    assert updates.updates(early) == {}
    panel = wire.Panel("toy", {"lever": {}}, {})
    updates.take(panel)
    updates.take(wire.PanelState({"lever": "up"}, {}))
    complete = {"robot": "toy", "controls": {"lever": {}}, "faults": {}}
    up = {"rows": [("lever", "up")], "at": {}}
    assert updates.updates(early) == {"panel": complete, "panel_state": up}
    assert updates.updates(early) == {}
    updates.take(wire.PanelState({"lever": "down"}, {}))
    assert updates.updates(early) == {"panel_state": {"rows": [("lever", "down")], "at": {}}}
    assert updates.updates(late).keys() == {"panel", "panel_state"}


# --- the server


@asynccontextmanager
async def served(operate: Callable[..., Any] | None) -> AsyncIterator[str]:
    """Serve a panel in this process; return the origin."""
    source = Nothing()
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.setblocking(False)
        server = Server(source, Admission(TOKEN, ("https://others.example",)), "panel.html")
        server.operate = operate
        task = asyncio.create_task(server.serve(listener))
        try:
            yield f"http://127.0.0.1:{listener.getsockname()[1]}"
        finally:
            source.over = True
            await task


GOOD = {TOKEN_HEADER: TOKEN, "Content-Type": "application/json"}


@pytest.mark.live
@pytest.mark.parametrize(
    ("headers", "body", "status"),
    [
        (GOOD, json.dumps(PRESS), 200),
        (GOOD, json.dumps({"do": "refused"}), 409),
        (GOOD, json.dumps({"do": "gone"}), 503),
        (GOOD, "[]", 400),
        (GOOD, "{", 400),
        (GOOD, json.dumps({"do": "x" * 2000}), 415),
        ({**GOOD, TOKEN_HEADER: "guess"}, json.dumps(PRESS), 403),
        ({"Content-Type": "application/json"}, json.dumps(PRESS), 403),
        ({**GOOD, "Content-Type": "text/plain"}, json.dumps(PRESS), 415),
        ({**GOOD, "Origin": "http://evil.example"}, json.dumps(PRESS), 403),
        ({**GOOD, "Host": "robot.example"}, json.dumps(PRESS), 403),
        ({**GOOD, "Sec-Fetch-Site": "cross-site"}, json.dumps(PRESS), 403),
    ],
)
async def test_panel_requires_token_and_json(headers: Mapping[str, str], body: str, status: int) -> None:
    requested = []

    async def operate(request: Mapping[str, Any]) -> str:
        requested.append(request)
        if request["do"] == "gone":
            raise ConnectionError("the robot's process does not answer")
        return "no" if request["do"] == "refused" else ""

    async with served(operate) as origin, aiohttp.ClientSession() as session:
        async with session.post(f"{origin}/panel", headers=headers, data=body) as answer:
            assert answer.status == status, await answer.text()
            assert "Access-Control-Allow-Origin" not in answer.headers
        async with session.options(f"{origin}/panel", headers={"Origin": "https://others.example"}) as answer:
            assert answer.status == 405, "a page of another origin may read, but not press"
    assert bool(requested) == (status in (200, 409, 503))


@pytest.mark.live
async def test_page_without_panel_has_no_controls() -> None:
    async with (
        served(None) as origin,
        aiohttp.ClientSession() as session,
        session.post(f"{origin}/panel", headers=GOOD, json=PRESS) as answer,
    ):
        assert answer.status == 404


# --- in a browser


def button(control: str, position: str) -> str:
    """Return the button of a control at this index, from 0."""
    return (
        "[...document.querySelectorAll('.control')]"
        f".find(row => row.querySelector('.name').textContent === '{control}')"
        f".querySelectorAll('button')[{position}]"
    )


def row(name: str) -> str:
    """Return the text after a heading of the panel's state."""
    return (
        f"[...document.querySelectorAll('.state dt')].find(one => one.textContent === '{name}')"
        ".nextElementSibling.textContent"
    )


@pytest.mark.live
@pytest.mark.parametrize(
    ("robot", "power", "state"),
    [
        ("egm", "motors", "motors"),
        ("rsi", "drives", "drives"),
        ("rtde", "power", "mode"),
        ("s3", "key", "state"),
    ],
)
async def test_robot_panel_is_operated_in_browser(
    page: Page, serving: list[Serving], tmp_path: Path, robot: str, power: str, state: str
) -> None:
    options = ("--robot-port", "egm+udp://127.0.0.1:9") if robot == "egm" else ()
    emulator = Serving(tmp_path, "emulate", "robot", "--robot", robot, "--web", *options)
    serving.append(emulator)
    await page.open(emulator.origin)
    await page.until("document.querySelectorAll('.control').length > 3")
    assert await page.value("[...document.querySelectorAll('.panel button')].every(one => one.disabled)"), (
        "without the token it only shows"
    )
    await page.open("about:blank")
    await page.open(emulator.url)
    await page.until("document.querySelectorAll('.control').length > 3")
    await page.until(f"{row('lasting')} === 'none'")
    before = await page.value(row(state))
    await page.value(f"{button('emergency stop', '0')}.click()")
    await page.until(f"{button('emergency stop', '0')}.getAttribute('aria-pressed') === 'true'")
    await page.until(f"{row(state)} !== {json.dumps(before)}")
    if robot in ("egm", "rsi", "rtde"):
        await page.value(f"{button(power, '0')}.click()")
        await page.until("document.querySelector('.said').textContent.startsWith('failed: ')")
    await page.value(f"{button('emergency stop', '1')}.click()")
    await page.until(f"{button('emergency stop', '1')}.getAttribute('aria-pressed') === 'true'")
    await page.value("document.querySelector('.injector button').click()")
    await page.until("document.querySelector('.said').textContent.startsWith('robot: ')")
    assert all("409" in one for one in page.errors), page.errors
    emulator.process.terminate()
    assert emulator.ended() == 0
    await page.until("!document.getElementById('cut').hidden")
    assert await page.value("[...document.querySelectorAll('.panel button')].every(one => one.disabled)")


@pytest.mark.live
async def test_emergency_stop_on_run_page_stops_run(page: Page, web_run: Callable[..., WebRun]) -> None:
    run = web_run("--robot", "egm", "--sensor", "netft", "--duration", "60", "--no-record")
    await page.open(run.url)
    await page.until("document.querySelectorAll('#hands .control').length > 3")
    assert not await page.value("document.getElementById('hands').hidden")
    await page.value(f"{button('program', '1')}.click()")
    await page.until(
        "[...document.querySelectorAll('#list li')].some(row => row.textContent.includes('at the panel'))"
    )
    await page.until("!document.getElementById('outcome').hidden")
    assert await page.value("[...document.querySelectorAll('#hands button')].every(one => one.disabled)")
    assert run.ended() == 3
