"""Transport over a CAN interface of python-can, driven by the event loop."""

import asyncio
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

import can

from hil_bridge.clock import Clock, Timer
from hil_bridge.errors import TransportError
from hil_bridge.transports import reasons
from hil_bridge.transports.base import Frames
from hil_bridge.transports.can.message import file_descriptor, from_message, is_full, to_message
from hil_bridge.transports.can.queue import SEND_DEADLINE_S, Arrived, CanStatistics, SendQueue
from hil_bridge.transports.can.reader import ReaderThread
from hil_bridge.transports.can.socketcan import LINK_LOST, Link
from hil_bridge.transports.delivery import QUEUE_FRAMES, Delivery, flush
from protocol.can.error import CanErrorReport, ErrorClass, ErrorState, decode_error, encode_error
from protocol.can.frame import CanFrame

MOST_PER_WAKE_UP = 256
"""Maximum number of reads before other tasks of the event loop run. Chosen: 30 ms of a full bus at 1 Mbit/s, in
approximately 3 ms.
"""

RETRY_S = 0.001
"""Time after which a frame is retried if the interface had no room for it, s. Chosen: ten frames at 1 Mbit/s, the
shortest queue of interfaces. Waiting for writability does not help, because the socket is writable while its
interface is full.
"""

PROBE_S = 0.05
"""Interval at which an interface that is down is checked, s. Chosen."""

LINK_PATIENCE_S = 10.0
"""Longest time for which a wire may be bus-off or its interface may be down before the wire is broken, s. Chosen:
an operator brings an interface up again, or reconnects an adapter, within that time.
"""

_STAMPED_BY_KERNEL = ("socketcan",)


@dataclass(frozen=True, slots=True)
class _Outage:
    """Outage of the wire."""

    since: float
    error: BaseException
    link: bool
    """Whether the interface is down. Otherwise the controller is bus-off."""


class Place(NamedTuple):
    """CAN bus of this computer."""

    interface: str
    """Name of the python-can interface: `socketcan` or `virtual`."""
    channel: str
    """Channel of the interface, such as `can0`."""
    name: str
    """URL of the wire as given by the user."""


class CanWire:
    """Transport over an open python-can bus.

    Frames for which the interface has no room wait in a queue. They are dropped if none of them is sent for
    `send_deadline_s`. An interface that goes down, or bus-off, has LINK_PATIENCE_S to recover. All of this is
    reported in band by error frames. This class generates INTERFACE_DOWN and TX_TIMEOUT, and RESTARTED when the
    interface is up again.

    Frames of SocketCAN contain the kernel's receive time: python-can enables SO_TIMESTAMPNS, and `Clock.at_wall`
    converts that time to the loop's time.
    """

    def __init__(
        self,
        bus: can.BusABC,
        place: Place,
        clock: Clock,
        link: Link | None = None,
        send_deadline_s: float = SEND_DEADLINE_S,
    ) -> None:
        self._bus = bus
        self._interface, self._channel, name = place
        self._clock = clock
        self._link = link
        self._delivery: Delivery[Frames] = Delivery(name, QUEUE_FRAMES)
        self._queue = SendQueue(name, send_deadline_s)
        self._open = True
        self._started = False
        self._outage: _Outage | None = None
        self._timer: Timer | None = None
        self._kernel_stamps = place.interface in _STAMPED_BY_KERNEL
        self._counts = Arrived()
        self.malformed = 0
        """Number of received frames that were not classical CAN frames."""
        self._thread: ReaderThread | None = None
        self._fd = file_descriptor(bus)

    @property
    def name(self) -> str:
        return self._delivery.name

    @property
    def statistics(self) -> CanStatistics:
        """Counts since opening."""
        overruns = self._delivery.overruns + (0 if self._thread is None else self._thread.overruns)
        return self._queue.statistics(self._counts, overruns, self.malformed)

    def start(self, on_data: Callable[[Frames], None], on_end: Callable[[TransportError], None]) -> None:
        self._delivery.start(on_data, on_end)
        self._started = True
        if not self._open:
            return
        if self._fd >= 0:
            if self._outage is None or not self._outage.link:
                self._listen()
        else:
            self._thread = ReaderThread(self._bus, self._clock, self._from_thread, self._break)

    def send(self, data: Frames) -> None:
        self._delivery.check()
        self._queue.put(data, self._clock.now())
        self._push()
        self._delivery.check()
        self._arm()

    async def aclose(self) -> None:
        if not self._delivery.begin_close():
            return
        try:
            await flush(self._drained())
        finally:
            thread = self._thread
            self._close()
            self._delivery.closed()
            if thread is not None:
                await asyncio.to_thread(thread.join)

    async def _drained(self) -> None:
        while self._open and len(self._queue):
            await self._clock.sleep_until(self._clock.now() + 0.002)

    # --- sending

    def _push(self) -> None:
        """Send as many frames as the interface accepts. Makes no callback except to report a broken wire."""
        while len(self._queue) and (self._outage is None or not self._outage.link):
            try:
                self._bus.send(to_message(self._queue.head), timeout=0)
            except (can.CanError, OSError) as error:
                if not is_full(error):
                    self._fail(error)
                break
            self._queue.left(self._clock.now())

    def _arm(self) -> None:
        """Set the timer for the next retry, drop or check."""
        if self._timer is not None or not self._open:
            return
        now = self._clock.now()
        if self._outage is not None:
            when = min(now + PROBE_S, self._queue.give_up_at)
        elif len(self._queue):
            when = min(now + RETRY_S, self._queue.give_up_at)
        else:
            return
        self._timer = self._clock.call_at(when, self._look)

    def _look(self) -> None:
        """Retry sending, drop frames that are too old, and check whether an outage is over or has lasted too long."""
        self._timer = None
        if not self._open:
            return
        now = self._clock.now()
        if self._outage is not None and self._outage.link:
            self._come_back()
        if self._outage is not None and now >= self._outage.since + LINK_PATIENCE_S:
            self._break(self._outage.error)
            return
        self._push()
        if self._queue.give_up(now):
            self._report(ErrorClass.TX_TIMEOUT)
        self._arm()

    # --- receiving

    def _listen(self) -> None:
        if self._started and self._fd >= 0:
            self._clock.loop.add_reader(self._fd, self._readable)

    def _readable(self) -> None:
        if not self._open:
            return
        frames: list[CanFrame] = []
        failure: BaseException | None = None
        try:
            self._drain(frames)
        except (can.CanError, OSError, ValueError) as error:
            failure = error
        self._arrived(frames)
        if failure is not None:
            self._fail(failure)

    def _drain(self, frames: list[CanFrame]) -> None:
        """Read all pending frames, up to the limit."""
        for _ in range(MOST_PER_WAKE_UP):
            message = self._bus.recv(0)
            if message is None:
                break
            at = self._clock.at_wall(message.timestamp) if self._kernel_stamps else self._clock.now()
            self._take(message, at, frames)

    def _take(self, message: can.Message, at: float, frames: list[CanFrame]) -> None:
        frame = from_message(message, at)
        if frame is None:
            self.malformed += 1
        else:
            frames.append(frame)

    def _from_thread(self, messages: list[tuple[float, can.Message]]) -> None:
        frames: list[CanFrame] = []
        for at, message in messages:
            self._take(message, at, frames)
        if self._open:
            self._arrived(frames)

    def _arrived(self, frames: list[CanFrame]) -> None:
        if not frames:
            return
        for frame in frames:
            if frame.error:
                self._counts.reports += 1
                self._judge(frame)
            else:
                self._counts.frames += 1
                self._back_on_bus()
        self._delivery.data(frames)
        self._arm()

    # --- outages

    def _judge(self, frame: CanFrame) -> None:
        """Track the controller's error state."""
        report = decode_error(frame)
        if report.state is ErrorState.BUS_OFF:
            self._counts.bus_off += 1
            if self._outage is None:
                self._outage = _Outage(self._clock.now(), reasons.BusOff(), link=False)
        elif report.state is not None:
            self._back_on_bus()

    def _back_on_bus(self) -> None:
        if self._outage is not None and not self._outage.link:
            self._outage = None
            if self._timer is not None:
                self._timer.cancel()
                self._timer = None

    def _fail(self, error: BaseException) -> None:
        """Handle an error. An interface that is down may return; any other error breaks the wire."""
        if self._link is None or reasons.error_number(error) not in LINK_LOST:
            self._break(error)
        elif self._outage is None or not self._outage.link:
            self._outage = _Outage(self._clock.now(), error, link=True)
            if self._fd >= 0:
                self._clock.loop.remove_reader(self._fd)
            # this may run within `send`, in which the client does not expect a callback
            self._clock.loop.call_soon(self._tell_down)
            self._arm()

    def _tell_down(self) -> None:
        """Report that the interface is down. Deliver the frames that arrived earlier first, because later they
        would appear new.
        """
        if not self._open:
            return
        frames: list[CanFrame] = []
        for _ in range(2):  # the socket may still have to report its error first
            with suppress(can.CanError, OSError):
                self._drain(frames)
        self._arrived(frames)
        self._report(ErrorClass.INTERFACE_DOWN)

    def _come_back(self) -> None:
        assert self._link is not None
        try:
            if not self._link.up:
                return
            self._bus = self._link.renew(self._bus)
        except (can.CanError, OSError):
            return
        self._fd = file_descriptor(self._bus)
        self._outage = None
        self._listen()
        self._report(ErrorClass.RESTARTED)

    def _report(self, matter: ErrorClass) -> None:
        self._counts.reports += 1
        self._delivery.data([encode_error(CanErrorReport(matter), self._clock.now())])

    def _break(self, error: BaseException) -> None:
        self._close()
        self._delivery.end(reasons.broken(f"can+{self._interface}", self.name, self._channel, error))

    def _close(self) -> None:
        if not self._open:
            return
        self._open = False
        self._queue.clear()
        if self._timer is not None:
            self._timer.cancel()
        if self._fd >= 0:
            self._clock.loop.remove_reader(self._fd)
        if self._thread is not None:
            self._thread.stop()
        with suppress(can.CanError, OSError):
            self._bus.shutdown()
