"""Tests of the port of an emulated controller's web services, in real time over TCP."""

import asyncio
import re
import time
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager

import aiohttp
import pytest
from aiohttp import web

from emulators.devices.egm import EgmController, EgmProfile, State
from emulators.devices.egm.web_login import SESSIONS_MAX
from emulators.seams import StartPose
from hil_bridge.clock import Clock, run_real
from hil_bridge.devices.kinds import default_settings
from hil_bridge.devices.robots.egm.room import ROBOT, serve
from hil_bridge.devices.robots.egm.web_address import WebAddress, split_web
from hil_bridge.devices.robots.egm.web_client import WebState, read_state
from hil_bridge.devices.wiring import Serving
from hil_bridge.errors import ConfigError, DeviceError
from hil_bridge.settings.configuration import load_config
from hil_bridge.settings.devices import robot_at
from hil_bridge.site.doctor import check_side_channel
from hil_bridge.site.robot_probe import probe, probe_rows
from protocol.devices.egm.web import PASSWORD, SUBSCRIPTION, USER

pytestmark = pytest.mark.live

START = StartPose((0.9, -0.1, 0.6), (0.0, 0.0, 1.0, 0.0), 0.2)
USUAL = (USER, PASSWORD)


@asynccontextmanager
async def served(listens: str = "127.0.0.1:0") -> AsyncIterator[tuple[EgmController, WebAddress]]:
    """Yield a controller whose web services listen."""
    clock = Clock.running()
    try:
        async with AsyncExitStack() as stack:
            controller = EgmController(EgmProfile(), START, clock.now(), 1)
            serving = Serving(clock, stack, print, print)
            url = f"udp://127.0.0.1:9?rws={listens}"
            _, address = split_web(await serve(url, controller, default_settings(ROBOT), serving))
            assert address is not None
            yield controller, address
    finally:
        clock.close()


def session_with(address: WebAddress, user: str, password: str) -> aiohttp.ClientSession:
    digest = aiohttp.DigestAuthMiddleware(user, password)
    return aiohttp.ClientSession(
        f"http://{address.authority}", middlewares=(digest,), cookie_jar=aiohttp.CookieJar(unsafe=True)
    )


def test_web_services_report_state_and_operator_stop() -> None:
    async def main() -> tuple[WebState, WebState]:
        async with served() as (controller, address):
            first = await read_state(address)
            controller.stop("motors-off", controller.next_deadline() or 0.0)
            return first, await read_state(address)

    first, second = run_real(main)
    assert first == WebState("7.00.00.00", "motoron", "AUTO", "running")
    assert (second.motors, second.execution) == ("motoroff", "stopped")


def test_subscriber_is_notified_of_rapid_stop() -> None:
    async def main() -> tuple[int, str, State]:
        async with served() as (controller, address), session_with(address, *USUAL) as session:
            body = {"resources": "1", "1": "/rw/rapid/execution;ctrlexecstate", "1-p": "1"}
            begun = await session.post("/subscription", data=body)
            socket = await session.ws_connect(begun.headers["Location"], protocols=(SUBSCRIPTION,))
            stopped = await session.post("/rw/rapid/execution?action=stop", data={"stopmode": "stop"})
            event = await socket.receive_str(timeout=10.0)
            await socket.close()
            return stopped.status, event, controller.session.state

    status, event, state = run_real(main)
    assert (status, state) == (204, State.RAPID_STOPPED)
    assert '<span class="ctrlexecstate">stopped</span>' in event


def test_wrong_password_is_refused() -> None:
    async def main() -> int:
        async with served() as (_, address), session_with(address, USER, "wrong") as session:
            return (await session.post("/rw/rapid/execution?action=stop")).status

    assert run_real(main) == 401


@pytest.mark.parametrize(
    ("data", "status"),
    [
        (b"\x00\xff\x16\x03\x01 nonsense\r\n\r\n", b"400"),
        (b"GET /rw/system HTTP/1.1\r\nHost: a\r\n\r\n", b"401"),
        (b"GET /" + b"a" * 20_000 + b" HTTP/1.1\r\n\r\n", b"400"),
        (b"POST /rw HTTP/1.1\r\nHost: a\r\nContent-Length: 9999999\r\n\r\n" + b"a" * 200_000, b"413"),
        (b"GET /poll/1 HTTP/1.1\r\nHost: a\r\nUpgrade: websocket\r\nConnection: upgrade\r\n\r\n", b"401"),
    ],
)
def test_invalid_request_gets_error_status(data: bytes, status: bytes) -> None:
    async def main() -> tuple[bytes, State]:
        async with served() as (controller, address):
            reader, writer = await asyncio.open_connection(*address)
            writer.write(data)
            line = await reader.readline()
            writer.transport.abort()
            await read_state(address)
            return line, controller.session.state

    line, state = run_real(main)
    assert line.split()[1] == status
    assert state in (State.SET_UP, State.GUIDING)


def test_number_of_connections_is_limited() -> None:
    async def main() -> None:
        async with served() as (_, address):
            idle = [await asyncio.open_connection(*address) for _ in range(64)]
            reader, writer = await asyncio.open_connection(*address)
            with pytest.raises((ConnectionError, asyncio.IncompleteReadError)):
                async with asyncio.timeout(30.0):  # less than an idle connection is let stand
                    await reader.readexactly(1)
            for _, one in [*idle, (reader, writer)]:
                one.transport.abort()
            await asyncio.sleep(0.1)
            await read_state(address)

    run_real(main)


def probe_of(make_url: Callable[[str], str], cause: str = "") -> tuple[str, float]:
    """Return the text of a probe of a robot whose web services listen, stopped for a cause, and its duration, s."""

    async def main() -> tuple[str, float]:
        async with served() as (controller, address):
            clock = Clock.running()
            if cause:
                controller.stop(cause, controller.next_deadline() or 0.0)
            begun = clock.now()
            report = await probe(ROBOT, make_url(address.authority), default_settings(ROBOT), clock)
            took = clock.now() - begun
            clock.close()
            return "\n".join(" ".join(row) for row in probe_rows(report)), took

    return run_real(main)


def test_probe_reads_web_services_without_datagrams() -> None:
    text, took = probe_of(lambda there: f"udp-bind://127.0.0.1:0?rws={there}", "motors-off")
    for part in ("datagrams robot on", "RobotWare 7.00.00.00", "refused: the motors are off (motoroff)"):
        assert part in text
    assert took < 5.0


def test_probe_reports_unanswered_web_services() -> None:
    text, _ = probe_of(lambda there: "udp-bind://127.0.0.1:0?rws=127.0.0.1:1")
    assert "RobotWare unknown: web services at 127.0.0.1:1: " in text
    assert "a run would be refused: robot on" in text


def test_doctor_reads_web_services_of_url() -> None:
    async def main() -> list[str]:
        async with served() as (controller, address):
            controller.stop("program-stopped", controller.next_deadline() or 0.0)
            url = f"egm+udp-bind://127.0.0.1:6510?rws={address.authority}"
            robot = robot_at(load_config(None, {}), url)
            return await asyncio.to_thread(
                lambda: [str(fact) for fact in check_side_channel("robot.url", robot)]
            )

    assert run_real(main) == [
        "ok    robot.url: RobotWare 7.00.00.00, motors motoron, mode AUTO, RAPID stopped",
        "fail  robot.url: the RAPID program is stopped (stopped); start the program",
    ]


Answers = Callable[[web.Request], web.Response]
VALUES = {
    "rwversion": "6.15.1234",
    "ctrlstate": "guardstop",
    "opmode": "MANR",
    "ctrlexecstate": "stopped",
}
NEWER = "are those of RobotWare 7 (RWS 2.0); only RobotWare 6 is supported"


async def read_from(answer: Answers) -> WebState:
    """Return the result of a query to a server with this answer."""

    async def take(request: web.Request) -> web.Response:
        return answer(request)

    app = web.Application()
    app.router.add_route("*", "/{path:.*}", take)
    runner = web.AppRunner(app, access_log=None)
    await runner.setup()
    try:
        site = web.TCPSite(runner, "127.0.0.1", 0)
        await site.start()
        return await read_state(WebAddress("127.0.0.1", runner.addresses[0][1]))
    finally:
        await runner.cleanup()


def xhtml(values: dict[str, str], more: str = "") -> web.Response:
    spans = "".join(f'<span class="{key}">{text}</span>' for key, text in values.items())
    text = (
        f'<?xml version="1.0"?>{more}<html xmlns="http://www.w3.org/1999/xhtml"><body><div class="state"><ul>'
        f'<li class="x" title="t"><a href="y"/>{spans}</li></ul></div></body></html>'
    )
    return web.Response(body=text.encode(), content_type="application/xhtml+xml")


def test_xhtml_answer_to_json_request_is_read() -> None:
    assert run_real(lambda: read_from(lambda request: xhtml(VALUES))) == WebState(*VALUES.values())


def basic(request: web.Request) -> web.Response:
    return web.Response(status=401, headers={"WWW-Authenticate": 'Basic realm="robotapi"'})


def version_2(request: web.Request) -> web.Response:
    return web.Response(body=b"{}", headers={"Content-Type": "application/hal+json;v=2.0"})


def not_acceptable(request: web.Request) -> web.Response:
    return web.Response(status=406, headers={"Content-Type": "application/xhtml+xml; v=2.0"})


def moved(request: web.Request) -> web.Response:
    return web.Response(status=301, headers={"Location": f"https://{request.host}{request.path}"})


def entities(request: web.Request) -> web.Response:
    return xhtml({"rwversion": "&a;"}, '<!DOCTYPE html [<!ENTITY a "6">]>')


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (basic, NEWER),
        (version_2, NEWER),
        (not_acceptable, NEWER),
        (moved, NEWER),
        (entities, "report no rwversion"),
        (lambda request: xhtml({"rwversion": ""}), "report no rwversion"),
        (lambda request: xhtml({"rwversion": "6\n"}), "report no rwversion"),
        (lambda request: web.Response(body=b"<html><unclosed"), "report no rwversion"),
        (lambda request: web.Response(body=b"[" * 100_000), "report no rwversion"),
        (lambda request: web.Response(body=b"<a>" * 60_000), "report no rwversion"),
        (lambda request: web.Response(status=404), r"answer /rw/system\?json=1 with 404; is it a controller"),
    ],
)
def test_other_web_services_are_reported(answer: Answers, message: str) -> None:
    expected = message if "\\" in message else re.escape(message)
    with pytest.raises(DeviceError, match=expected):
        run_real(lambda: read_from(answer))


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"\x15\x03\x03\x00\x02\x02\x28", NEWER),
        (b"", "disconnected"),
        (b"SSH-2.0-OpenSSH_9.2\r\n", "web services at 127"),
    ],
)
def test_port_without_http_is_reported(data: bytes, message: str) -> None:
    """The first bytes are a TLS alert: a server without a common version."""

    async def main() -> None:
        async def take(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            first = await reader.read(1)
            if first == b"\x16" or not data.startswith(b"\x15"):
                writer.write(data)
            writer.close()

        server = await asyncio.start_server(take, "127.0.0.1", 0)
        try:
            await read_state(WebAddress("127.0.0.1", server.sockets[0].getsockname()[1]))
        finally:
            server.close()

    begun = time.monotonic()
    with pytest.raises(DeviceError, match=re.escape(message)):
        run_real(main)
    assert time.monotonic() - begun < 5.0


def test_query_closes_its_session() -> None:
    """A controller has 70 sessions, and keeps each for minutes."""

    async def main() -> None:
        async with served() as (_, address):
            for _ in range(SESSIONS_MAX + 1):
                await read_state(address)

    run_real(main)


def test_missing_answer_is_reported_with_address() -> None:
    async def main() -> None:
        with pytest.raises(DeviceError, match=r"web services at 127\.0\.0\.1:1"):
            await read_state(WebAddress("127.0.0.1", 1))

    run_real(main)


@pytest.mark.parametrize(
    ("there", "message"),
    [("0.0.0.0:0", "loopback only"), ("127.0.0.1:70000", "HOST:PORT"), ("a b", "HOST:PORT")],
)
def test_invalid_address_is_refused(there: str, message: str) -> None:
    async def main() -> None:
        async with served(there):
            pass

    with pytest.raises(ConfigError, match=message):
        run_real(main)
