"""Thread that reads a python-can interface which has no file descriptor to wait on."""

import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress

import can

from hil_bridge.clock import Clock
from hil_bridge.transports.delivery import QUEUE_FRAMES

_LOOKS_S = 0.1
"""Interval at which the thread checks whether it is to end, s."""


class ReaderThread:
    """Thread that reads until it is stopped or the interface fails. It delivers frames and their times in the event
    loop's thread.
    """

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
        """Number of frames that were lost because the event loop was too slow."""
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name="CAN reader", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Request the end of the thread."""
        self._stopping = True

    def join(self) -> None:
        """Wait until the thread has ended."""
        self._thread.join()

    def _run(self) -> None:
        while not self._stopping:
            try:
                message = self._bus.recv(_LOOKS_S)
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
