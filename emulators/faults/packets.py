"""Faulty wire: an endpoint that wraps the endpoint of a device and loses, delays, duplicates and damages packets.

The kind of packet depends on the wire: a byte of a serial line, a CAN frame, a datagram, or a package of a protocol
over TCP.
"""

import random
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

from emulators.faults.kinds import FOREVER, Fault, Parameter
from emulators.faults.ledger import Handler, Injection
from protocol.can.frame import CanFrame
from protocol.datagram import Datagram, side_of
from protocol.endpoint import Deferrable, Endpoint

Data = TypeVar("Data", bound=Sequence[Any])

WIRE, SENSOR_WIRE = "wire", "sensor-wire"
"""Targets of the wire faults: the wire of the cell's robot and the wire of its sensor."""

_BOTH, _TO, _FROM = "both", "to", "from"
_DIRECTIONS: Mapping[str, str] = {"mute": _FROM, "deaf": _TO}
"""Direction of each fault that has no parameter for the direction; all other such faults apply to both directions."""
_WAY = Parameter(_BOTH, "direction: to the device, from it, or both", choices=(_BOTH, _TO, _FROM))


@dataclass(frozen=True, slots=True)
class Pieces(Generic[Data]):
    """Functions that split the data of a wire into packets and damage packets."""

    name: str
    """Name of the packets, in the plural."""
    take_apart: Callable[[Data], list[Any]]
    """Function that splits data into packets."""
    join: Callable[[list[Any]], Data]
    """Function that joins packets to data."""
    corrupt: Callable[[Any, random.Random], Any]
    """Function that flips one bit of a packet."""
    garble: Callable[[Any, random.Random], Any]
    """Function that replaces the contents of a packet by random data."""
    cut: Callable[[Any], Any] | None = None
    """Function that cuts off the second half of a packet. None for bytes of a serial line, which cannot be cut or
    reordered.
    """

    @property
    def faults(self) -> Mapping[str, Fault]:
        """Faults of a wire that carries these packets."""
        return wire_faults(self)


def wire_faults(pieces: Pieces[Any]) -> Mapping[str, Fault]:
    """Return the definitions of the faults of a wire that carries these packets."""
    packets = pieces.name

    def random_fault(meaning: str, probability: float, lasts_s: float = FOREVER) -> Fault:
        parameters = {
            "probability": Parameter(probability, f"probability for each of the {packets}", 0.0, 1.0),
            "count": Parameter(0, f"number of affected {packets}; 0: no limit", 0, 100_000),
            "way": _WAY,
        }
        return Fault(meaning, parameters, lasts_s)

    faults = {
        "off": Fault("the cable is cut: nothing arrives", {}, 2.0),
        "mute": Fault("nothing that the device sends arrives", {}, FOREVER),
        "deaf": Fault("nothing arrives at the device", {}, FOREVER),
        "lost": random_fault(f"some {packets} are lost", 0.05),
        "late": Fault(
            f"all {packets} are delayed",
            {"ms": Parameter(100.0, "delay", 0.0, 10000.0, "ms"), "way": _WAY},
            FOREVER,
        ),
        "twice": random_fault(f"some {packets} arrive twice", 0.05),
        "corrupted": random_fault(f"one bit of some {packets} is flipped", 0.02),
        "garbled": random_fault(f"random {packets} arrive instead of those sent", 1.0, 1.0),
    }
    if pieces.cut is not None:
        faults["malformed"] = random_fault(f"{packets} arrive cut off in the middle", 1.0)
        faults["reordered"] = random_fault(f"of two {packets} the second arrives first", 1.0)
    return faults


def _corrupt_bytes(data: bytes, draw: random.Random) -> bytes:
    if not data:
        return data
    bit, damaged = draw.randrange(8 * len(data)), bytearray(data)
    damaged[bit // 8] ^= 1 << bit % 8
    return bytes(damaged)


def _garble_bytes(data: bytes, draw: random.Random) -> bytes:
    return draw.randbytes(len(data))


def _cut_bytes(data: bytes) -> bytes:
    return data[: len(data) // 2]


def _with(frame: CanFrame, data: bytes) -> CanFrame:
    return CanFrame(frame.identifier, data, frame.extended, frame.remote, frame.error)


def _corrupt_frame(frame: CanFrame, draw: random.Random) -> CanFrame:
    bit = draw.randrange(8 * max(len(frame.data), 1))
    data = bytearray(frame.data)
    if data:
        data[bit // 8] ^= 1 << bit % 8
    return _with(frame, bytes(data))


BYTES: Pieces[bytes] = Pieces(
    "bytes",
    list,
    bytes,
    lambda byte, draw: byte ^ 1 << draw.randrange(8),
    lambda byte, draw: draw.randrange(256),
)
FRAMES: Pieces[Sequence[CanFrame]] = Pieces(
    "frames",
    list,
    list[CanFrame],
    _corrupt_frame,
    lambda frame, draw: _with(frame, draw.randbytes(len(frame.data))),
    lambda frame: _with(frame, _cut_bytes(frame.data)),
)
DATAGRAMS: Pieces[Sequence[bytes]] = Pieces(
    "datagrams", list, list[bytes], _corrupt_bytes, _garble_bytes, _cut_bytes
)


def packages(name: str, take_apart: Callable[[bytes], list[bytes]]) -> Pieces[bytes]:
    """Return the pieces of a protocol over a byte stream. `take_apart` receives the bytes of one direction."""
    return Pieces(name, take_apart, b"".join, _corrupt_bytes, _garble_bytes, _cut_bytes)


class _Direction(Generic[Data]):
    """One direction of a wire.

    It has its own random numbers, so that it does not depend on the traffic in the other direction.
    """

    def __init__(self, pieces: Pieces[Data], draw: random.Random) -> None:
        self._pieces = pieces
        self._draw = draw
        self.faults: list[Injection] = []
        self.under_way: deque[tuple[float, list[Any]]] = deque()
        """Delayed packets, each with its arrival time, s."""
        self._kept_back: list[Any] = []
        """Packet that is sent after its successor; empty if no packet is held back."""

    def take(self, data: Data, now: float) -> None:
        """Accept data that enter the wire."""
        late = 0.0
        packets = self._pieces.take_apart(data)
        for injection in self.faults:
            if not injection.holds(now) or not packets:
                continue
            match injection.fault:
                case "off" | "mute" | "deaf":
                    injection.struck += len(packets)
                    packets = []
                case "late":
                    injection.struck += len(packets)
                    late += injection.number("ms") * 1e-3
                case _:
                    packets = [
                        each for packet in packets for each in self._replacements(packet, injection, now)
                    ]
        if packets and self._kept_back and not self._reorders(now):
            packets[1:1], self._kept_back = self._kept_back, []
        if packets:
            at = now + late
            if self.under_way:
                at = max(at, self.under_way[-1][0])
            self.under_way.append((at, packets))

    def arrived(self, now: float) -> Data:
        """Return the data that have arrived by now."""
        packets: list[Any] = []
        while self.under_way and self.under_way[0][0] <= now:
            packets += self.under_way.popleft()[1]
        return self._pieces.join(packets)

    def _reorders(self, now: float) -> bool:
        """Return whether a fault that changes the order of packets is active."""
        return any(each.fault == "reordered" and each.holds(now) for each in self.faults)

    def _replacements(self, packet: Any, injection: Injection, now: float) -> Sequence[Any]:
        """Return the packets that replace a packet under this fault."""
        pieces, draw = self._pieces, self._draw
        if injection.fault == "reordered" and self._kept_back:
            before, self._kept_back = self._kept_back, []
            return [packet, *before]
        if not injection.holds(now) or draw.random() >= injection.number("probability"):
            return (packet,)
        injection.strike(now)
        match injection.fault:
            case "corrupted":
                return (pieces.corrupt(packet, draw),)
            case "garbled":
                return (pieces.garble(packet, draw),)
            case "twice":
                return packet, packet
            case "malformed":
                assert pieces.cut is not None, "otherwise this wire does not have the fault"
                return (pieces.cut(packet),)
            case "reordered":
                self._kept_back = [packet]
                return ()
            case _:  # lost
                return ()


class Packets(Generic[Data]):
    """End of a wire at the device: the endpoint of the device, behind the faults of the wire.

    Without a fault, it only forwards data.
    """

    def __init__(self, inner: Endpoint[Data, Data, None], pieces: Pieces[Data], seed: int | str) -> None:
        self.wrapped = inner
        """Endpoint of the device."""
        self._in: _Direction[Data] = _Direction(pieces, random.Random(f"{seed} to the device"))
        self._out: _Direction[Data] = _Direction(pieces, random.Random(f"{seed} from the device"))
        self._bad = False
        """Whether the wire has or had a fault, so that delayed packets may exist."""
        self.handlers: Mapping[str, Handler] = dict.fromkeys(pieces.faults, Handler(self.begin))
        """Fault handlers for a ledger, by fault name."""

    def receive(self, data: Data, now: float) -> None:
        """Accept data sent to the device, and pass on all data that arrive now."""
        if self._bad:
            self._in.take(data, now)
            data = self._in.arrived(now)
        self.wrapped.receive(data, now)

    def next_event(self) -> None:
        """Return None, because a device emits no events."""

    def data_to_send(self, now: float) -> Data:
        """Return the data from the device that arrive now, including delayed data."""
        data = self.wrapped.data_to_send(now)
        if not self._bad:
            return data
        if len(data):
            self._out.take(data, now)
        return self._out.arrived(now)

    def next_deadline(self) -> float | None:
        """Return the time at which the device has something to do or delayed data arrive, s."""
        due = self.wrapped.next_deadline()
        if self._bad:
            for direction in (self._in, self._out):
                if direction.under_way and (due is None or direction.under_way[0][0] < due):
                    due = direction.under_way[0][0]
        return due

    def handle_deadline(self, now: float) -> None:
        """Deliver delayed data to the device, and handle the deadline of the device."""
        if self._bad and len(data := self._in.arrived(now)):
            self.wrapped.receive(data, now)
        self.wrapped.handle_deadline(now)

    def begin(self, injection: Injection) -> None:
        """Apply a fault to all data sent from now on."""
        self._bad = True
        which = str(injection.values.get("way", _DIRECTIONS.get(injection.fault, _BOTH)))
        for direction in self._directions(which):
            direction.faults.append(injection)

    def _directions(self, which: str) -> Iterator[_Direction[Data]]:
        if which in (_BOTH, _TO):
            yield self._in
        if which in (_BOTH, _FROM):
            yield self._out


class StampedPackets(Packets[Sequence[bytes]]):
    """Packets of a device that gives each datagram the time at which it leaves. A `Deferrable`."""

    def __init__(self, inner: "StampedDevice", seed: int | str) -> None:
        super().__init__(inner, DATAGRAMS, seed)
        self._stamped = inner

    def data_to_send(self, now: float) -> Sequence[bytes]:
        """Return the datagrams that arrive now. Behind a faulty wire, they have no times of their own."""
        data = super().data_to_send(now)
        return [Datagram(one, side=side_of(one)) for one in data] if self._bad else data

    def last_deadline(self, until: float) -> float:
        """Return the last deadline up to `until`, s. Behind a faulty wire, each deadline is handled at its time."""
        deadline = self.next_deadline() if self._bad else None
        return self._stamped.last_deadline(until) if deadline is None else deadline


class StampedDevice(Endpoint[Sequence[bytes], Sequence[bytes], None], Deferrable, Protocol):
    """Device behind `StampedPackets`."""
