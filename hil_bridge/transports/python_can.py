"""Every CAN interface of python-can, driven by the event loop; each wake-up takes all pending frames."""

import asyncio
import errno
import fcntl
import os
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import can
from can.interfaces.slcan import slcanBus

from hil_bridge.clock import Clock
from hil_bridge.errors import TransportError
from hil_bridge.transports import reasons
from hil_bridge.transports.base import Frames, Transport
from hil_bridge.transports.delivery import QUEUE_FRAMES, Delivery, flush
from hil_bridge.transports.slcan_port import SlcanPort
from protocol.can import CanFrame

_FULL = (errno.ENOBUFS, errno.EAGAIN)
_STAMPED_BY_KERNEL = ("socketcan",)
_LONGEST_LINE = 64
"""More than any slcan line has: an extended frame with 8 bytes and a time stamp has 30 characters."""
_THREAD_LOOKS_S = 0.1
"""How often the reader thread looks whether it shall end."""


async def open_python_can(
    interface: str, channel: str, clock: Clock, name: str, **options: Any
) -> Transport[Frames]:
    """Open an interface: `socketcan`, `virtual` or `slcan`. Raises TransportUnavailable."""
    opening = asyncio.ensure_future(asyncio.to_thread(_open, interface, channel, options))
    try:
        bus = await asyncio.shield(opening)
    except asyncio.CancelledError:
        # the thread cannot be stopped: what it opens must be closed when it is done
        opening.add_done_callback(_close_opened)
        raise
    except (can.CanError, OSError, ValueError) as error:
        raise reasons.unavailable(f"can+{interface}", name, channel, error) from error
    return _CanWire(bus, interface, channel, clock, name)


def _open(interface: str, channel: str, options: dict[str, Any]) -> can.BusABC:
    match interface:
        case "slcan":
            _check_free(channel)
            options = {"sleep_after_open": 0.0, "timeout": 0.0, **options}
        case "virtual":
            options = {"rx_queue_size": QUEUE_FRAMES, **options}
    bus = can.Bus(channel=channel, interface=interface, ignore_config=True, **options)
    if isinstance(bus, slcanBus):
        bus.serialPortOrig.exclusive = True
    return bus


def _check_free(port: str) -> None:
    """Raise OSError when another program has locked the port: python-can would talk into its conversation."""
    fd = os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    finally:
        os.close(fd)


def _close_opened(opening: "asyncio.Future[can.BusABC]") -> None:
    if not opening.cancelled() and opening.exception() is None:
        opening.result().shutdown()


class _CanWire:
    """Transport over an open python-can bus. A batch that does not fit is sent up to the frame that fails."""

    def __init__(self, bus: can.BusABC, interface: str, channel: str, clock: Clock, name: str) -> None:
        self._bus = bus
        self._interface = interface
        self._channel = channel
        self._clock = clock
        self._delivery: Delivery[Frames] = Delivery(name, QUEUE_FRAMES)
        self._open = True
        self._kernel_stamps = interface in _STAMPED_BY_KERNEL
        self.malformed = 0
        """Arrivals that were no classical CAN frame."""
        self._port: SlcanPort | None = None
        self._thread: _ReaderThread | None = None
        if isinstance(bus, slcanBus):
            bus.serialPortOrig = self._port = SlcanPort(bus.serialPortOrig)
        try:
            self._fd = bus.fileno()
        except NotImplementedError:
            self._fd = -1

    @property
    def name(self) -> str:
        return self._delivery.name

    def start(self, on_data: Callable[[Frames], None], on_end: Callable[[TransportError], None]) -> None:
        self._delivery.start(on_data, on_end)
        if not self._open:
            return
        if self._fd >= 0:
            self._clock.loop.add_reader(self._fd, self._readable)
        else:
            self._thread = _ReaderThread(self._bus, self._clock, self._from_thread, self._break)

    def send(self, data: Frames) -> None:
        self._delivery.check()
        for frame in data:
            message = can.Message(
                arbitration_id=frame.identifier,
                is_extended_id=frame.extended,
                is_remote_frame=frame.remote,
                data=frame.data,
            )
            try:
                self._bus.send(message, timeout=0)
            except can.CanError as error:
                if _is_full(error):
                    raise TransportError(f"{self.name}: the send queue is full; the bus is slower") from error
                self._break(error)
                self._delivery.check()
        if self._port is not None and self._port.unsent:
            self._clock.loop.add_writer(self._fd, self._writable)

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
        while self._port is not None and self._port.unsent and self._open:
            await self._clock.sleep_until(self._clock.now() + 0.002)

    def _readable(self) -> None:
        frames: list[CanFrame] = []
        failure: BaseException | None = None
        try:
            if self._port is not None:
                self._port.fill()
            self._drain(frames)
        except (can.CanError, OSError) as error:
            failure = error
        if frames:
            self._delivery.data(frames)
        if failure is not None:
            self._break(failure)

    def _drain(self, frames: list[CanFrame]) -> None:
        """Take all pending frames."""
        bus, port = self._bus, self._port
        while True:
            try:
                message = bus.recv(0)
            except (ValueError, IndexError):
                self.malformed += 1  # text that is no slcan
                continue
            except can.CanError as error:
                if not isinstance(error.__cause__, UnicodeDecodeError):
                    raise
                self._forget_input()
                continue
            if message is not None:
                self._take(message, frames)
            elif port is None or not port.in_waiting:
                # slcan says None for an acknowledgement too, though frames may follow
                break
        if port is not None and port.unfinished > _LONGEST_LINE:
            self._forget_input()

    def _forget_input(self) -> None:
        """python-can keeps text for ever that it cannot decode or whose end does not come."""
        assert isinstance(self._bus, slcanBus)
        self._bus.flush()
        self.malformed += 1

    def _take(self, message: can.Message, frames: list[CanFrame]) -> None:
        frame = _frame(
            message,
            self._clock.at_wall(message.timestamp) if self._kernel_stamps else self._clock.now(),
        )
        if frame is None:
            self.malformed += 1
        else:
            frames.append(frame)

    def _from_thread(self, messages: list[tuple[float, can.Message]]) -> None:
        frames = [frame for at, message in messages if (frame := _frame(message, at)) is not None]
        self.malformed += len(messages) - len(frames)
        if frames and self._open:
            self._delivery.data(frames)

    def _writable(self) -> None:
        assert self._port is not None
        try:
            self._port.push()
        except OSError as error:
            self._break(error)
            return
        if not self._port.unsent:
            self._clock.loop.remove_writer(self._fd)

    def _break(self, error: BaseException) -> None:
        self._close()
        self._delivery.end(reasons.broken(f"can+{self._interface}", self.name, self._channel, error))

    def _close(self) -> None:
        if not self._open:
            return
        self._open = False
        if self._fd >= 0:
            self._clock.loop.remove_reader(self._fd)
            self._clock.loop.remove_writer(self._fd)
        if self._thread is not None:
            self._thread.stop()
        with suppress(can.CanError, OSError):
            self._bus.shutdown()
        if self._port is not None:
            # not reached by python-can when its last command fails
            with suppress(OSError):
                self._port.close()


class _ReaderThread:
    """Reads an interface that has no file descriptor."""

    def __init__(
        self,
        bus: can.BusABC,
        clock: Clock,
        on_messages: Callable[[list[tuple[float, can.Message]]], None],
        on_error: Callable[[BaseException], None],
    ) -> None:
        self._bus = bus
        self._clock = clock
        self._on_messages = on_messages
        self._on_error = on_error
        self._pending: deque[tuple[float, can.Message]] = deque(maxlen=QUEUE_FRAMES)
        self._lock = threading.Lock()
        self.overruns = 0
        """Frames lost because the event loop was too slow."""
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name="CAN reader", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Ask it to end."""
        self._stopping = True

    def join(self) -> None:
        """Wait until it has ended."""
        self._thread.join()

    def _run(self) -> None:
        while not self._stopping:
            try:
                message = self._bus.recv(_THREAD_LOOKS_S)
            except (can.CanError, OSError, ValueError) as error:
                if not self._stopping:
                    self._call(self._on_error, error)
                return
            if message is not None:
                with self._lock:
                    first = not self._pending
                    self.overruns += len(self._pending) == QUEUE_FRAMES
                    self._pending.append((self._clock.now(), message))
                if first:
                    self._call(self._hand_over)

    def _call(self, callback: Callable[..., None], *arguments: object) -> None:
        with suppress(RuntimeError):  # the loop is closed
            self._clock.loop.call_soon_threadsafe(callback, *arguments)

    def _hand_over(self) -> None:
        with self._lock:
            messages = list(self._pending)
            self._pending.clear()
        self._on_messages(messages)


def _frame(message: can.Message, at: float) -> CanFrame | None:
    """A message as a frame, or None when it is not a classical CAN frame."""
    if message.is_fd or (len(message.data) != message.dlc and not message.is_remote_frame):
        return None
    try:
        return CanFrame(
            message.arbitration_id,
            bytes(message.data),
            extended=message.is_extended_id,
            remote=message.is_remote_frame,
            error=message.is_error_frame,
            received_at=at,
        )
    except ValueError:
        return None


def _is_full(error: can.CanError) -> bool:
    """Whether sending failed only for now; python-can says it by number or in words."""
    return (
        reasons.error_number(error) in _FULL
        or isinstance(error.__cause__, BlockingIOError)
        or str(error).startswith(("Transmit buffer full", "Could not send message to one or more"))
    )
