"""Connections of the clients of an emulated control box, as endpoints of bytes."""

import math
import random
from collections import deque
from collections.abc import Callable

from emulators.orders import Act, ReceivedOrder
from hil_xarm.box import Box
from hil_xarm.commands import Commands
from hil_xarm.frames import HEARTBEAT, MODBUS, Frame, FrameReader, Reply
from hil_xarm.modbus import answer_modbus
from hil_xarm.reporting import read_report
from hil_xarm.reports import Port
from protocol.endpoint import RemoteProtocolError


class Stalls:
    """Stalls of the command channel: now and then a command takes long, and those behind it wait."""

    def __init__(self, box: Box, seed: int) -> None:
        self._box, self._draw = box, random.Random(f"{seed} stalls")
        self.until = -math.inf
        """Time until which no command is carried out, s."""

    def arrive(self, now: float) -> None:
        """Draw whether the command that arrives now takes long."""
        fault = self._box.faults.under_way("stalls", now) if self._box.faults.any else None
        if fault is not None and now >= self.until and self._draw.random() < fault.number("probability"):
            self.until = now + fault.number("ms") / 1e3


class CommandConnection:
    """Connection to port 502."""

    def __init__(self, box: Box, stalls: Stalls) -> None:
        self._box, self._stalls = box, stalls
        self._commands, self._reader = Commands(box), FrameReader()
        self._waiting: deque[tuple[float, Frame]] = deque()
        """Commands with the time at which each is carried out, s."""
        self._out: list[bytes] = []
        self.closing = False

    def receive(self, data: bytes, now: float) -> None:
        """Take commands. A connection with bytes that are no frame is closed (assumed)."""
        try:
            for frame in self._reader.feed(data):
                if frame.protocol == HEARTBEAT:
                    self._box.report_order(ReceivedOrder(now, Act.CONTACT, "heartbeat", True))
                    continue
                self._stalls.arrive(now)
                at = max(now + self._box.profile.answer_ms / 1e3, self._stalls.until)
                self._waiting.append((at, frame))
        except RemoteProtocolError as error:
            self._box.report_order(ReceivedOrder(now, Act.UNREADABLE, str(error), False))
            self.closing = True

    def next_event(self) -> None:
        """Return None: there are no events."""

    def data_to_send(self, now: float) -> bytes:
        """Return the replies, once."""
        out, self._out = self._out, []
        return b"".join(out)

    def next_deadline(self) -> float | None:
        """Return the time at which the next command is carried out, s."""
        return self._waiting[0][0] if self._waiting else None

    def handle_deadline(self, now: float) -> None:
        """Carry out the commands that are due."""
        while self._waiting and self._waiting[0][0] <= now:
            at, frame = self._waiting.popleft()
            if frame.protocol == MODBUS:
                self._out.append(answer_modbus(self._box, frame, at))
                continue
            request = frame.as_request()
            state, data = self._commands.carry_out(request, at)
            reply = Reply(request.transaction, request.protocol, request.function, state, data)
            self._out.append(reply.encode())

    def close(self, now: float) -> None:
        """Do nothing: the arm stays at its last target, whoever leaves."""


class ReportConnection:
    """Connection to a port that sends reports."""

    def __init__(
        self, box: Box, port: Port, now: float, on_report: Callable[[int, float], object] | None = None
    ) -> None:
        """Begin with the next report after `now`. `on_report` is called with the number of each report, from 1, and its
        time.
        """
        profile = box.profile
        periods = {
            Port.REAL: profile.real_ms,
            Port.NORMAL: profile.normal_ms,
            Port.RICH: profile.rich_ms,
            Port.RT: profile.rt_ms,
        }
        self._box, self._port, self._on_report = box, port, on_report
        self._period, self._count = periods[port] / 1e3, 0
        self._number = self._newest(now) + 1
        self._out = b""
        self.closing = False

    def _newest(self, now: float) -> int:
        return math.floor((now - self._box.powered_at) / self._period + 1e-6)

    def receive(self, data: bytes, now: float) -> None:
        """Ignore the data: clients only listen here."""

    def next_event(self) -> None:
        """Return None: there are no events."""

    def data_to_send(self, now: float) -> bytes:
        """Return the newest report, once."""
        out, self._out = self._out, b""
        return out

    def next_deadline(self) -> float | None:
        """Return the time of the next report, s."""
        return self._box.powered_at + self._number * self._period

    def handle_deadline(self, now: float) -> None:
        """Send the newest report that is due. Earlier ones are skipped if this process is late."""
        newest = self._newest(now)
        if newest < self._number or self._box.faults.under_way("mute", now):
            self._number = max(self._number, newest + 1)
            return
        self._number, self._count = newest + 1, self._count + 1
        at = min(self._box.powered_at + newest * self._period, now)
        self._out = read_report(self._port, self._box, at)
        if self._on_report is not None:
            self._on_report(self._count, at)

    def close(self, now: float) -> None:
        """Do nothing."""
