"""Run side of the live page. It starts the serving process and sends the records to it without blocking."""

import asyncio
import importlib.util
import os
import secrets
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import IO

import msgspec

from hil_bridge.devices.panel import LocalPanel, PanelView
from hil_bridge.errors import ConfigError
from hil_bridge.errors.extras import install_command
from hil_bridge.record import CycleRecord, RunEnd
from hil_bridge.record.topics import Record
from hil_bridge.show.charts.cell import CellModel
from hil_bridge.show.terminal import Health, Scene
from hil_bridge.show.web import wire

LOOPBACK = "127.0.0.1"
BATCH_S = 0.03
"""Time on the run's clock that one message covers, s. Chosen: a page is drawn less often."""
BATCH_RECORDS = 48
"""Maximum number of records in one message. Chosen: far below `wire.MOST_BYTES`."""
WAITING_RECORDS = 1024
"""Maximum number of records that wait for the end of a batch."""
BUFFER_BYTES = 1 << 20
"""Requested size of the socket buffer, bytes; Linux may grant less."""
CLOSE_SECONDS = 3.0
"""Longest wait for the serving process to notify its clients of the end, s. Chosen."""
NEEDED = ("aiohttp", "foxglove")
RUN_PAGE, PANEL_PAGE = "page.html", "panel.html"


@dataclass(frozen=True, slots=True)
class WebOptions:
    """Settings of the page."""

    port: int = 0
    """Port on the loopback address; 0 for any free port."""
    origins: tuple[str, ...] = ()
    """Origins of other pages that may read the data, for example https://app.foxglove.dev."""
    page: str = RUN_PAGE
    """Kind of page: for a run, or for the panel of an emulated robot."""


def check_extra(what: str) -> None:
    """Raise ConfigError if the extra `web` is not installed."""
    if any(importlib.util.find_spec(name) is None for name in NEEDED):
        raise ConfigError(f"{what} needs the extra web: {install_command('web')}")


def listening(port: int) -> socket.socket:
    """Open a socket that listens on the loopback address. Raises ConfigError."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        sock.bind((LOOPBACK, port))
        sock.listen(32)
    except OSError as error:
        sock.close()
        raise ConfigError(
            f"the page cannot listen on {LOOPBACK}:{port}: {error.strerror}; name another port with --web-port"
        ) from error
    sock.setblocking(False)
    return sock


class Feed:
    """Sender of a run's records to the process that serves its page.

    Call all methods from the run's event loop thread. `put`, `cycle`, `event` and `pulse` never wait: data that the
    socket does not accept are dropped and counted. If the serving process ends, `gone` is called once, and the run
    continues.
    """

    def __init__(self, options: WebOptions) -> None:
        """Start the serving process. Raises ConfigError if the extra is not installed, or the port is in use."""
        check_extra("--web")
        self._retract: Callable[[], object] | None = None
        self._gone: Callable[[str], object] | None = None
        self._waiting: list[Record] = []
        self._sent_at = 0.0
        self._alive = True
        self._loop: asyncio.AbstractEventLoop | None = None
        self._panel: LocalPanel | None = None
        self._panel_view: PanelView | None = None
        """State of the panel that was sent last."""
        self.dropped = 0
        """Number of records that were not sent."""
        token = secrets.token_urlsafe(24)
        listener = listening(options.port)
        port: int = listener.getsockname()[1]
        self.url = f"http://{LOOPBACK}:{port}/#token={token}"
        """URL of the page, with the token of this run in the fragment, which browsers do not send."""
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER_BYTES)
        self._socket.setblocking(False)
        self._told: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115
        with listener, theirs:
            self._process = _start(
                (theirs.fileno(), listener.fileno()), token, (options.page, *options.origins), self._told
            )

    def listen(self, retract: Callable[[], object], gone: Callable[[str], object]) -> None:
        """Receive messages of the page in the running event loop.

        `retract` is called when the page requests the end. `gone` is called with a text when the serving process
        has ended.
        """
        self._retract, self._gone = retract, gone
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._socket, self._receive)

    def _receive(self) -> None:
        try:
            word = self._socket.recv(wire.REQUEST_BYTES)
        except BlockingIOError:
            return
        except OSError:
            word = b""
        if word == wire.RETRACT and self._retract is not None:
            self._retract()
        elif not word:
            self._lose()
        elif self._panel is not None:
            with suppress(msgspec.DecodeError):
                self._operate(self._panel, wire.decode_request(word))

    def _lose(self) -> None:
        if not self._alive:
            return
        self._alive = False
        self._deafen()
        last = ""
        with suppress(OSError):  # other code has closed it
            self._told.seek(0)
            last = self._told.read(65536).decode(errors="replace").strip().rpartition("\n")[2]
        if self._gone is not None:
            self._gone(f"the page's server has ended{last and f': {last[:300]}'}")

    def _deafen(self) -> None:
        if self._loop is not None:
            self._loop.remove_reader(self._socket)
            self._loop = None

    def offer(self, panel: LocalPanel) -> None:
        """Let pages with the token operate the panel of an emulated controller, and display its state."""
        self._panel = panel
        controls = panel.perform({"do": "controls"})["controls"]
        faults = panel.perform({"do": "faults"})["faults"]
        self._send(wire.encode_message(wire.Panel(panel.robot, controls, faults)), 0)
        self.show_panel()

    def show_panel(self) -> None:
        """Send the state of the panel if it has changed. Does nothing without a panel."""
        if self._panel is not None and self._alive and (view := self._panel.view()) != self._panel_view:
            self._panel_view = view
            self._send(wire.encode_message(wire.PanelState(view.rows, view.at)), 0)

    def _operate(self, panel: LocalPanel, request: wire.PanelRequest) -> None:
        error = ""
        try:
            panel.perform(request.request)
        except ValueError as refused:
            error = str(refused)
        self.show_panel()
        self._send(wire.encode_message(wire.PanelResponse(request.number, error)), 0)

    def begin(self, scene: Scene, unix_zero_ns: int, model: CellModel | None = None) -> None:
        """Send the facts of the run, and the constant part of the cell's picture; call it again when they change."""
        self._send(wire.encode_message(wire.Begin(scene, unix_zero_ns, model or CellModel())), 0)

    def devices(self, facts: Mapping[str, str]) -> None:
        """Send the facts of the devices, as JSON by name, once the devices are ready."""
        self._send(wire.encode_message(wire.Devices(facts)), 0)

    def put(self, record: Record) -> None:
        """Queue a record."""
        if not self._alive:
            return
        if len(self._waiting) >= WAITING_RECORDS:
            self.dropped += 1
            return
        self._waiting.append(record)

    def cycle(self, record: CycleRecord) -> None:
        """Send the queued records if a batch is due, in the idle time after a cycle."""
        if len(self._waiting) >= BATCH_RECORDS or not 0 <= record.answered_at - self._sent_at < BATCH_S:
            self._sent_at = record.answered_at
            self.flush()

    def flush(self) -> None:
        """Send all queued records."""
        while self._waiting:
            batch, self._waiting = self._waiting[:BATCH_RECORDS], self._waiting[BATCH_RECORDS:]
            self._send(wire.encode_records(batch), len(batch))

    def pulse(self, now: float, health: Health, check: str = "", warning: str = "") -> None:
        """Send the time and the link health, after all queued records."""
        self.flush()
        self._send(wire.encode_message(wire.Pulse(now, health, self.dropped, check, warning)), 0)

    def _send(self, data: bytes, records: int) -> None:
        if not self._alive:
            return
        try:
            if len(data) > wire.MOST_BYTES:
                raise BlockingIOError
            self._socket.send(data, socket.MSG_NOSIGNAL)
        except BlockingIOError:
            self.dropped += records
        except OSError:
            self._lose()

    def end(self, end: RunEnd) -> None:
        """Send the end of the run, after all records."""
        self.flush()
        self._send(wire.encode_message(wire.End(end.as_metadata())), 0)

    def close(self) -> None:
        """End the serving process, which first notifies its clients. Waits at most CLOSE_SECONDS. Idempotent."""
        if self._told.closed:
            return
        self._alive = False
        self._deafen()
        self._socket.close()
        try:
            self._process.wait(CLOSE_SECONDS)
        except subprocess.TimeoutExpired:
            self._process.send_signal(signal.SIGKILL)
            self._process.wait()
        self._told.close()


def _start(
    sockets: Sequence[int], token: str, argv: Sequence[str], log: IO[bytes]
) -> "subprocess.Popen[bytes]":
    """Start the serving process with the page and the origins as arguments.

    The process has a separate session, so that Ctrl-C reaches only the run. The token is passed in the environment
    because other users can read the arguments but not the environment.
    """
    arguments = [sys.executable, "-P", "-m", "hil_bridge.show.web", *map(str, sockets), *argv]
    return subprocess.Popen(
        arguments,
        pass_fds=sockets,
        start_new_session=True,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=log,
        env={**os.environ, "HIL_BRIDGE_WEB_TOKEN": token},
    )
