"""The wires of all connections to a controller as faults let them through: one cable carries them."""

from collections.abc import Mapping

from emulators.devices.rtde.connection import Connection
from emulators.devices.rtde.dashboard import Dashboard
from emulators.devices.rtde.script import ScriptPort
from emulators.faults.ledger import Handler, Injection
from emulators.faults.wire import BYTES, WIRE_FAULTS, FaultyWire


class BadWires:
    """The faults of the cable, for the connections that are open and for those to come."""

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._injections: list[Injection] = []
        self._wires: list[FaultyWire[bytes]] = []
        self._opened = 0
        self.handlers: Mapping[str, Handler] = {name: Handler(self._begin) for name in WIRE_FAULTS}
        """Handlers for a ledger."""

    def open(self, now: float) -> FaultyWire[bytes]:
        """A wire for another connection, with the faults that hold now."""
        self._opened += 1
        wire: FaultyWire[bytes] = FaultyWire(BYTES, f"{self._seed} link {self._opened}")
        for injection in self._injections:
            if injection.holds(now):
                wire.begin(injection)
        self._wires.append(wire)
        return wire

    def close(self, wire: FaultyWire[bytes]) -> None:
        """The connection has ended."""
        self._wires.remove(wire)

    def _begin(self, injection: Injection) -> None:
        self._injections.append(injection)
        for wire in self._wires:
            wire.begin(injection)


class Server:
    """The controller's end of one connection: an endpoint of bytes that tells no events, behind its wire."""

    def __init__(
        self, inner: Connection | Dashboard | ScriptPort, wire: FaultyWire[bytes], wires: BadWires
    ) -> None:
        self._inner, self._wire, self._wires = inner, wire, wires

    @property
    def closing(self) -> bool:
        """Whether the controller is about to close the connection."""
        return self._inner.closing

    def receive(self, data: bytes, now: float) -> None:
        """Take bytes from the client."""
        if self._wire.bad:
            data = self._wire.incoming(data, now)
        self._inner.receive(data, now)

    def next_event(self) -> None:
        """There is none."""

    def data_to_send(self, now: float) -> bytes:
        """Bytes for the client."""
        out = self._inner.data_to_send(now)
        return self._wire.outgoing(out, now) if self._wire.bad else out

    def next_deadline(self) -> float | None:
        """When something is due, s."""
        due = self._inner.next_deadline()
        return self._wire.next_deadline(due) if self._wire.bad else due

    def handle_deadline(self, now: float) -> None:
        """Do what is due."""
        if self._wire.bad and (data := self._wire.arrived(now)):
            self._inner.receive(data, now)
        self._inner.handle_deadline(now)

    def close(self, now: float) -> None:
        """The connection has ended."""
        self._wires.close(self._wire)
        self._inner.close(now)
