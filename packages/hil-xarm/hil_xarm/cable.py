"""Cable between an emulated control box and its clients, which carries all their connections and their faults."""

from collections.abc import Mapping
from typing import Protocol

from emulators.faults.kinds import Fault
from emulators.faults.ledger import Handler, Injection
from emulators.faults.packets import Packets, packages
from hil_xarm.frames import frames_in
from hil_xarm.reports import Port, reports_in
from protocol.endpoint import Endpoint

_FRAMES, _REPORTS = packages("messages", frames_in), packages("messages", reports_in)
CABLE_FAULTS: Mapping[str, Fault] = _FRAMES.faults
"""Faults of a cable. A message is a command, its reply, or a report."""


class Inner(Endpoint[bytes, bytes, None], Protocol):
    """Box's end of a connection, without its cable."""

    closing: bool

    def close(self, now: float) -> None:
        """Handle the end of the connection."""


class Server:
    """Box's end of a connection behind its cable: a `ClientEndpoint`."""

    def __init__(self, inner: Inner, wire: Packets[bytes], cable: "Cable") -> None:
        self._inner, self._wire, self._cable = inner, wire, cable
        self.receive, self.data_to_send, self.next_event = wire.receive, wire.data_to_send, wire.next_event
        self.next_deadline, self.handle_deadline = wire.next_deadline, wire.handle_deadline

    @property
    def closing(self) -> bool:
        """Whether the box closes the connection."""
        return self._inner.closing

    def close(self, now: float) -> None:
        """End the connection."""
        self._cable.close(self._wire)
        self._inner.close(now)


class Cable:
    """Faults of a cable, for present and future connections."""

    def __init__(self, seed: str) -> None:
        self._seed, self._opened = seed, 0
        self._injections: list[Injection] = []
        self._wires: list[Packets[bytes]] = []
        self.handlers: Mapping[str, Handler] = dict.fromkeys(CABLE_FAULTS, Handler(self._begin))

    def open(self, inner: Inner, port: Port, now: float) -> Server:
        """Return the box's end of a new connection."""
        self._opened += 1
        pieces = _FRAMES if port is Port.COMMAND else _REPORTS
        wire = Packets(inner, pieces, f"{self._seed} link {self._opened}")
        for injection in self._injections:
            if injection.holds(now):
                wire.begin(injection)
        self._wires.append(wire)
        return Server(inner, wire, self)

    def close(self, wire: Packets[bytes]) -> None:
        """Forget a connection that has ended."""
        self._wires.remove(wire)

    def _begin(self, injection: Injection) -> None:
        self._injections.append(injection)
        for wire in self._wires:
            wire.begin(injection)
