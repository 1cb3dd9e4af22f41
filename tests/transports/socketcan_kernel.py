"""Kernel's side of a SocketCAN socket, simulated by a python-can bus, after net/can/raw.c and the drivers."""

import errno
import os
from collections import deque
from collections.abc import Awaitable, Callable
from typing import Any

import can

from hil_bridge.clock import Clock, run_virtual
from hil_bridge.errors import TransportError
from hil_bridge.transports.can.message import to_message
from hil_bridge.transports.can.wire import CanWire, Place
from protocol.can.error import CanErrorReport, ErrorClass, decode_error, encode_error
from protocol.can.frame import CanFrame

PATIENCE = 0.1
"""The send deadline."""
BUS_OFF = encode_error(CanErrorReport(ErrorClass.BUS_OFF))
RESTARTED = encode_error(CanErrorReport(ErrorClass.RESTARTED))


def failure(number: int) -> can.CanOperationError:
    """Return an error as raised by python-can."""
    return can.CanOperationError(f"Failed: {os.strerror(number)}", number)


class Kernel(can.BusABC):
    """Socket and the interface that it is bound to."""

    def __init__(self, clock: Clock, fd: int = 1000) -> None:
        super().__init__("can0")
        self.clock = clock
        self.fd = fd
        self.room = 1_000_000
        """Frames that the interface accepts before it is full."""
        self.up = True
        self.error: int | None = None
        """Error of the next call, once."""
        self.pending: deque[can.Message] = deque()
        self.sent: list[tuple[float, can.Message]] = []
        self.closed = False
        self.reader: Callable[[], None] | None = None
        self.renewed: list[Kernel] = []
        clock.loop.add_reader = self._add_reader  # type: ignore[assignment]
        clock.loop.remove_reader = self._remove_reader  # type: ignore[assignment]
        clock.loop.remove_writer = lambda fd: False  # type: ignore[method-assign]

    def _add_reader(self, fd: int, callback: Callable[[], None]) -> None:
        kernel = self._of(fd)
        kernel.reader = callback
        kernel.wake()

    def _remove_reader(self, fd: int) -> bool:
        self._of(fd).reader = None
        return True

    def _of(self, fd: int) -> "Kernel":
        return next(kernel for kernel in (self, *self.renewed) if kernel.fd == fd)

    # --- events of the interface

    def arrive(self, *frames: CanFrame) -> None:
        """Add received frames, or reports of the driver."""
        for frame in frames:
            message = to_message(frame)
            message.is_error_frame = frame.error
            self.pending.append(message)
        self.wake()

    def go_down(self, number: int = errno.ENETDOWN) -> None:
        """Set the interface down, or remove it with ENODEV."""
        self.up = False
        self.error = number
        self.wake()

    def wake(self) -> None:
        """Wake the event loop as long as there is something to read."""
        if self.reader is not None and (self.pending or self.error is not None):
            self.clock.loop.call_soon(self._level)

    def _level(self) -> None:
        if self.reader is not None and (self.pending or self.error is not None):
            self.reader()
            self.wake()

    # --- python-can's side

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        assert timeout == 0
        if not self.up:
            raise failure(errno.ENETDOWN)
        if self.room == 0:
            raise failure(errno.ENOBUFS)
        self.room -= 1
        self.sent.append((self.clock.now(), msg))

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        assert timeout == 0
        assert not self.closed
        if self.error is not None:
            number, self.error = self.error, None
            raise failure(number)
        return (self.pending.popleft() if self.pending else None), True

    def fileno(self) -> int:
        return self.fd

    def shutdown(self) -> None:
        super().shutdown()
        self.closed = True

    # --- the interface as a link

    def renew(self, bus: can.BusABC) -> can.BusABC:
        if not self.renewed:
            return bus
        bus.shutdown()
        return self.renewed[0]

    @property
    def numbers(self) -> list[int]:
        """Identifiers that were sent, in order."""
        return [message.arbitration_id for _, message in self.sent]


class Ear:
    """Deliveries of the wire."""

    def __init__(self, wire: CanWire, clock: Clock) -> None:
        self.frames: list[CanFrame] = []
        self.reports: list[tuple[float, ErrorClass]] = []
        self.batches: list[int] = []
        self.ends: list[TransportError] = []
        self.within_send = False
        self._clock = clock
        wire.start(self._data, self.ends.append)

    def _data(self, frames: Any) -> None:
        assert not self.within_send
        self.batches.append(len(frames))
        for frame in frames:
            if frame.error:
                self.reports.append((self._clock.now(), decode_error(frame).classes))
            else:
                self.frames.append(frame)

    @property
    def classes(self) -> list[ErrorClass]:
        return [classes for _, classes in self.reports]


def run_check(check: Callable[[Clock, Kernel, CanWire, Ear], Awaitable[None]]) -> None:
    """Run a check on an open wire in virtual time, then close the wire."""

    async def main() -> None:
        clock = Clock.running()
        kernel = Kernel(clock)
        wire = CanWire(kernel, Place("socketcan", "can0", "can+socketcan://can0"), clock, kernel)
        ear = Ear(wire, clock)
        await check(clock, kernel, wire, ear)
        await wire.aclose()
        assert len(ear.ends) == 1
        assert kernel.closed or kernel.renewed

    run_virtual(main)


def frames(count: int, first: int = 0x100) -> list[CanFrame]:
    return [CanFrame(first + k) for k in range(count)]
