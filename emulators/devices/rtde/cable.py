"""Cable of a controller, which carries all its connections and their faults."""

from collections.abc import Callable, Mapping
from typing import TypeAlias

from emulators.devices.rtde.connection import Connection
from emulators.devices.rtde.dashboard import Dashboard
from emulators.devices.rtde.faults import DROPPED
from emulators.devices.rtde.packages import MESSAGES, PACKAGES
from emulators.devices.rtde.primary import PrimaryPort
from emulators.devices.rtde.program_socket import ProgramSocket
from emulators.devices.rtde.realtime import RealtimePort
from emulators.devices.rtde.script import ScriptPort
from emulators.faults.ledger import Handler, Injection
from emulators.faults.packets import Packets, Pieces

Inner: TypeAlias = Connection | Dashboard | ScriptPort | PrimaryPort | RealtimePort | ProgramSocket
"""Controller's end of a connection, without its wire."""


class Server:
    """Controller's end of one connection behind its wire: an endpoint of bytes without events."""

    def __init__(self, inner: Inner, wire: Packets[bytes], cable: "Cable") -> None:
        self._inner, self._wire, self._cable = inner, wire, cable
        self.receive, self.data_to_send, self.next_event = wire.receive, wire.data_to_send, wire.next_event
        self.next_deadline, self.handle_deadline = wire.next_deadline, wire.handle_deadline

    @property
    def closing(self) -> bool:
        """Whether the controller is about to close the connection."""
        return self._inner.closing

    def spare(self, is_full: Callable[[], bool]) -> None:
        """Pause a client's stream if its wire is full."""
        if isinstance(self._inner, RealtimePort | Connection):
            self._inner.is_full = is_full

    def close(self, now: float) -> None:
        """End the connection."""
        self._cable.close(self._wire)
        self._inner.close(now)


class Cable:
    """Faults of the cable, for current and future connections."""

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._injections: list[tuple[Injection, bool]] = []
        """Active faults, each with a flag: whether it affects only the connections of programs."""
        self._wires: dict[Packets[bytes], ProgramSocket | None] = {}
        """Open wires, each with the program's end of it, or None if a client opened it."""
        self._opened = 0
        self.handlers: Mapping[str, Handler] = dict.fromkeys(PACKAGES.faults, Handler(self._begin))
        """Fault handlers for a ledger, for all connections."""
        self.program_handlers: Mapping[str, Handler] = {
            **dict.fromkeys(MESSAGES.faults, Handler(self._begin_of_programs)),
            DROPPED: Handler(self._hang_up),
        }
        """Fault handlers for a ledger, for the connections opened by programs."""

    def open(self, inner: Inner, now: float) -> Server:
        """Return the controller's end of a new connection, subject to the active faults."""
        self._opened += 1
        pieces: Pieces[bytes] = PACKAGES if isinstance(inner, Connection) else MESSAGES
        wire = Packets(inner, pieces, f"{self._seed} link {self._opened}")
        of_program = inner if isinstance(inner, ProgramSocket) else None
        for injection, of_programs in self._injections:
            if injection.holds(now) and (of_program is not None or not of_programs):
                wire.begin(injection)
        self._wires[wire] = of_program
        return Server(inner, wire, self)

    def close(self, wire: Packets[bytes]) -> None:
        """End the connection."""
        del self._wires[wire]

    def _begin(self, injection: Injection) -> None:
        self._injections.append((injection, False))
        for wire in self._wires:
            wire.begin(injection)

    def _begin_of_programs(self, injection: Injection) -> None:
        self._injections.append((injection, True))
        for wire, of_program in self._wires.items():
            if of_program is not None:
                wire.begin(injection)

    def _hang_up(self, injection: Injection) -> None:
        for socket in list(self._wires.values()):
            if socket is not None:
                socket.hang_up()
                injection.struck += 1
