"""Process that serves the page of a run. It ends with the run, even if the run is killed."""

import asyncio
import ctypes
import itertools
import os
import resource
import signal
import socket
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any

import msgspec
from aiohttp import ClientSession

from hil_bridge.show.web import wire
from hil_bridge.show.web.admission import Admission
from hil_bridge.show.web.feed import LOOPBACK, RUN_PAGE, listening
from hil_bridge.show.web.panel_updates import PanelUpdates
from hil_bridge.show.web.panels import Panels
from hil_bridge.show.web.run_source import Cursor, RunSource
from hil_bridge.show.web.server import PageSource, Server
from hil_bridge.show.web.splicing import Splicing

NICE = 10
"""Niceness of the process relative to the run. Chosen."""
LOG_BYTES = 1 << 20
"""Largest size of the log file, bytes. The process writes no other file."""
ANSWER_SECONDS = 5.0
"""Longest wait for a response of the panel, s. Chosen: the panel responds at once, even on a busy computer."""
LAST_SECONDS = 5
"""Time limit for notifying the pages of the end of the run, s. Chosen."""
_PR_SET_PDEATHSIG = 1
"""Operation code of prctl. Source: Linux, prctl(2)."""


class Live:
    """Receiver of a run's messages, and source of its page updates."""

    def __init__(self, run: socket.socket) -> None:
        self._run, self._numbers = run, itertools.count(1)
        self.source: RunSource | None = None
        self.panels: Panels | None = None
        self.begun = asyncio.Event()
        self._panel = PanelUpdates()
        self._pending: dict[int, asyncio.Future[str]] = {}
        """Pending panel requests, by request number."""
        self.over = False
        """Whether the run has ended."""

    def first(self) -> Cursor:
        """Return the state of a new page."""
        return Cursor()

    def updates(self, state: Cursor) -> Mapping[str, Any] | None:
        """Return the changes of the run and of the panel, or None."""
        update = (None if self.source is None else self.source.updates(state)) or {}
        return {**update, **self._panel.updates(state)} or None

    def handle_request(self, state: Any, message: Mapping[str, Any]) -> None:
        """Reject every request. Raises ValueError."""
        raise ValueError("the page of a live run accepts no requests")

    def retract(self) -> None:
        """Request the run to retract and end."""
        with suppress(OSError):
            self._run.send(wire.RETRACT)

    async def operate(self, request: Mapping[str, Any]) -> str:
        """Send a request to the panel of the run; return the error, or an empty text on success.

        Raises ConnectionError.
        """
        if not self._panel.is_there:
            return "there is no panel yet"
        number = next(self._numbers)
        answer: asyncio.Future[str]
        answer = self._pending[number] = asyncio.get_running_loop().create_future()
        try:
            self._run.send(wire.encode_message(wire.PanelRequest(number, request)))
            async with asyncio.timeout(ANSWER_SECONDS):
                return await answer
        except (OSError, TimeoutError):
            raise ConnectionError("the robot's process does not answer") from None
        finally:
            del self._pending[number]

    def receive(self) -> None:
        """Receive messages of the run in small batches, so that clients are served in between."""
        for _ in range(32):
            try:
                data = self._run.recv(wire.MOST_BYTES)
            except BlockingIOError:
                return
            except OSError:
                data = b""
            if not data:
                if self.source is not None:
                    self.source.lost()
                asyncio.get_running_loop().remove_reader(self._run)
                self.over = True
                return
            self._take(wire.decode_message(data))

    def _take(self, message: wire.Message) -> None:
        present = time.monotonic()
        if isinstance(message, (wire.Panel, wire.PanelState, wire.PanelResponse)):
            self._receive_panel(message)
            return
        if isinstance(message, wire.Begin):
            if self.source is None:
                self.source = RunSource(message, present)
                self.panels = Panels(message.unix_zero_ns)
                self.begun.set()
            else:
                self.source.begin(message)
            return
        if self.source is None or self.panels is None:
            return
        if isinstance(message, wire.Devices):
            self.panels.devices(message.facts)
        elif isinstance(message, wire.Records):
            for record in wire.records_of(message):
                self.source.take(record)
                self.panels.take(record)
        elif isinstance(message, wire.Pulse):
            self.source.pulse(message, present)
        else:
            self.source.end(message)

    def _receive_panel(self, message: wire.Panel | wire.PanelState | wire.PanelResponse) -> None:
        if not isinstance(message, wire.PanelResponse):
            self._panel.take(message)
        elif (waiting := self._pending.get(message.number)) is not None and not waiting.done():
            waiting.set_result(message.error)


async def serve(run: socket.socket, listener: socket.socket, admission: Admission, page: str) -> None:
    """Serve until the run has ended and the pages have received all updates."""
    run.setblocking(False)
    listener.setblocking(False)
    live = Live(run)
    asyncio.get_running_loop().add_reader(run, live.receive)
    server = Server(live, admission, page)
    server.operate = live.operate
    server.retract = live.retract if page == RUN_PAGE else None
    async with ClientSession() as session:
        opening = asyncio.create_task(_open(live, server, session))
        try:
            await server.serve(listener)
        finally:
            opening.cancel()
            if live.panels is not None:
                live.panels.close()


async def _open(live: Live, server: Server, session: ClientSession) -> None:
    """Serve Foxglove's protocol once the run has begun."""
    await live.begun.wait()
    assert live.panels is not None
    server.splice = Splicing(server, session, live.panels.url)


def show(source: PageSource, page: str, port: int, say: Callable[[str], object]) -> None:
    """Serve a static page from this process until Ctrl-C. `say` is called with the URL of the page.

    Raises ConfigError.
    """
    with listening(port) as listener:
        say(f"page: http://{LOOPBACK}:{listener.getsockname()[1]}/   Ctrl-C ends it")
        with suppress(KeyboardInterrupt):
            asyncio.run(Server(source, Admission(""), page).serve(listener))


def settle(parent: int) -> None:
    """Limit this process: end it with the run's process, lower its priority, and limit the size of its files.

    Normally the process ends when the run's socket closes, after it has notified the pages. A signal from the
    system ensures that it ends.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda *_: signal.alarm(LAST_SECONDS))  # SIGALRM ends the process
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:
        raise SystemExit("the run has ended")
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))  # does not preempt a running process
    os.nice(NICE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (LOG_BYTES, LOG_BYTES))


def main(arguments: Sequence[str]) -> None:
    """Serve on inherited sockets.

    The arguments are the run's socket, the listening socket, the page, then the origins. The token is in the
    environment.
    """
    run, listener, page, *origins = arguments
    token = os.environ.pop("HIL_BRIDGE_WEB_TOKEN")
    with socket.socket(fileno=int(run)) as ours, socket.socket(fileno=int(listener)) as web:
        settle(os.getppid())
        with suppress(msgspec.DecodeError):
            asyncio.run(serve(ours, web, Admission(token, tuple(origins)), page))
