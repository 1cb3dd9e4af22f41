"""Real-time interface: it sends the controller's state in each cycle, and accepts program text unless it is
read-only.
"""

from collections.abc import Callable

from emulators.devices.rtde.connection import has_room
from emulators.devices.rtde.controller import Controller
from emulators.devices.rtde.disturbance import Disturbance
from emulators.devices.rtde.script import ScriptPort
from emulators.devices.rtde.state import Snapshot, getter
from protocol.devices.rtde.realtime import layout_of


class RealtimePort:
    """Connection to the real-time port, as an endpoint of bytes.

    A client that does not read receives nothing until it reads again. Derived: ur_rtde sends its program here and
    never reads, and its connection persists.
    """

    closing = False

    def __init__(self, controller: Controller, disturbance: Disturbance, now: float, read_only: bool) -> None:
        controller.advance(now)
        self._controller, self._disturbance = controller, disturbance
        self._script = None if read_only else ScriptPort(controller)
        self._layout = layout_of(controller.version)
        self._getters = [getter(name) if name else _read_nothing for name in self._layout.outputs]
        self._due = controller.path.cycle + 1
        self._out: list[bytes] = []
        self.is_full: Callable[[], bool] = has_room
        """Whether the wire still holds data that the client has not read."""

    def receive(self, data: bytes, now: float) -> None:
        if self._script is not None:
            self._script.receive(data, now)
        elif data.strip():
            self._controller.counts["text to a read-only interface"] += 1

    def next_event(self) -> None:
        return None

    def data_to_send(self, now: float) -> bytes:
        out, self._out = self._out, []
        return b"".join(out)

    def next_deadline(self) -> float | None:
        return self._controller.path.cycle_at(self._due)

    def handle_deadline(self, now: float) -> None:
        """Send the newest state that is due. A process that is late skips the states that it missed."""
        self._controller.advance(now)
        cycle = self._controller.path.cycle
        if self._due > cycle:
            return
        self._due = cycle + 1
        if self.is_full():
            self._controller.counts["real-time states left out"] += 1
            return
        snapshot = self._disturbance.reported(self._controller.snapshots[0])
        self._out.append(self._layout.encode([value for read in self._getters for value in read(snapshot)]))

    def close(self, now: float) -> None:
        """End the connection."""


def _read_nothing(state: Snapshot) -> tuple[float, ...]:
    return (0.0,)
