"""Packets of a bad wire: an endpoint around a device's own, which loses, keeps back, doubles and damages what passes.

What a packet is depends on the wire: a byte of a line, a CAN frame, a datagram, or a package of a protocol over TCP.
"""

import random
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from emulators.faults.kinds import FOREVER, Fault, Parameter
from emulators.faults.ledger import Handler, Injection
from protocol.can.frame import CanFrame
from protocol.endpoint import Endpoint

Data = TypeVar("Data", bound=Sequence[Any])

WIRE, SENSOR_WIRE = "wire", "sensor-wire"
"""Targets of these faults: a cell has the wire of its robot and that of its sensor."""

_BOTH, _TO, _FROM = "both", "to", "from"
_WAYS: Mapping[str, str] = {"mute": _FROM, "deaf": _TO}
"""Which way a fault goes that is not told it; both for all others."""
_WAY = Parameter(_BOTH, "what travels to the device, from it, or both", choices=(_BOTH, _TO, _FROM))


@dataclass(frozen=True, slots=True)
class Pieces(Generic[Data]):
    """How a wire's data are taken apart into packets."""

    name: str
    """Plural, for people."""
    take_apart: Callable[[Data], list[Any]]
    """Data to packets."""
    join: Callable[[list[Any]], Data]
    """Packets to data."""
    corrupt: Callable[[Any, random.Random], Any]
    """A packet with one bit turned over."""
    garble: Callable[[Any, random.Random], Any]
    """A packet with other contents."""
    cut: Callable[[Any], Any] | None = None
    """The first half of a packet. None for bytes of a line, which have no halves and never change their order."""

    @property
    def faults(self) -> Mapping[str, Fault]:
        """The faults that such a wire can have."""
        return wire_faults(self)


def wire_faults(pieces: Pieces[Any]) -> Mapping[str, Fault]:
    """Words for the faults of a wire that carries these packets."""
    them = pieces.name

    def by_chance(meaning: str, probability: float, lasts_s: float = FOREVER) -> Fault:
        parameters = {
            "probability": Parameter(probability, f"of each of the {them}", 0.0, 1.0),
            "count": Parameter(0, "it is over after so many; 0 for any number", 0, 100_000),
            "way": _WAY,
        }
        return Fault(meaning, parameters, lasts_s)

    faults = {
        "off": Fault("the cable is cut: nothing arrives", {}, 2.0),
        "mute": Fault("nothing that the device sends arrives", {}, FOREVER),
        "deaf": Fault("nothing arrives at the device", {}, FOREVER),
        "lost": by_chance(f"some {them} are lost", 0.05),
        "late": Fault(
            f"all {them} come later",
            {"ms": Parameter(100.0, "by how much", 0.0, 10000.0, "ms"), "way": _WAY},
            FOREVER,
        ),
        "twice": by_chance(f"some {them} come twice", 0.05),
        "corrupted": by_chance(f"one bit of some {them} is turned over", 0.02),
        "garbled": by_chance(f"random {them} come in place of what was sent", 1.0, 1.0),
    }
    if pieces.cut is not None:
        faults["malformed"] = by_chance(f"{them} come cut off in the middle", 1.0)
        faults["reordered"] = by_chance(f"of two {them} the second comes first", 1.0)
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
    """Return packages of a protocol over a byte stream. `take_apart` gets the bytes of one side."""
    return Pieces(name, take_apart, b"".join, _corrupt_bytes, _garble_bytes, _cut_bytes)


class _Way(Generic[Data]):
    """One direction, with draws of its own: so that neither direction depends on the traffic of the other."""

    def __init__(self, pieces: Pieces[Data], draw: random.Random) -> None:
        self._pieces = pieces
        self._draw = draw
        self.faults: list[Injection] = []
        self.under_way: deque[tuple[float, list[Any]]] = deque()
        """Late packets, each with the time at which they come, s."""
        self._kept_back: list[Any] = []
        """The packet, if any, that comes behind its successor."""

    def take(self, data: Data, now: float) -> None:
        """Let data begin their way."""
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
                    packets = [each for packet in packets for each in self._struck(packet, injection, now)]
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
        """Whether a fault that changes the order is under way."""
        return any(each.fault == "reordered" and each.holds(now) for each in self.faults)

    def _struck(self, packet: Any, injection: Injection, now: float) -> Sequence[Any]:
        """Return the data that come in the place of a packet."""
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
                assert pieces.cut is not None, "else it is no fault of this wire"
                return (pieces.cut(packet),)
            case "reordered":
                self._kept_back = [packet]
                return ()
            case _:  # lost
                return ()


class Packets(Generic[Data]):
    """The end of a device's wire: the device's own endpoint behind the faults of the wire.

    Without a fault it only hands on.
    """

    def __init__(self, inner: Endpoint[Data, Data, None], pieces: Pieces[Data], seed: int | str) -> None:
        self._inner = inner
        self._in: _Way[Data] = _Way(pieces, random.Random(f"{seed} to the device"))
        self._out: _Way[Data] = _Way(pieces, random.Random(f"{seed} from the device"))
        self._bad = False
        """Whether a fault is, or was, on it: then something may still be under way."""
        self.handlers: Mapping[str, Handler] = dict.fromkeys(pieces.faults, Handler(self.begin))
        """Handlers for a ledger."""

    def receive(self, data: Data, now: float) -> None:
        """Take what was sent to the device; it receives those, of them or of earlier ones, that come through now."""
        if self._bad:
            self._in.take(data, now)
            data = self._in.arrived(now)
        self._inner.receive(data, now)

    def next_event(self) -> None:
        """Return None: a device has no events."""

    def data_to_send(self, now: float) -> Data:
        """Return the data that come out of the wire now, of all that the device sends and has sent."""
        data = self._inner.data_to_send(now)
        if not self._bad:
            return data
        if len(data):
            self._out.take(data, now)
        return self._out.arrived(now)

    def next_deadline(self) -> float | None:
        """When the device has something to do, or something late comes through, s."""
        due = self._inner.next_deadline()
        if self._bad:
            for way in (self._in, self._out):
                if way.under_way and (due is None or way.under_way[0][0] < due):
                    due = way.under_way[0][0]
        return due

    def handle_deadline(self, now: float) -> None:
        """Let the device have what is due."""
        if self._bad and len(data := self._in.arrived(now)):
            self._inner.receive(data, now)
        self._inner.handle_deadline(now)

    def begin(self, injection: Injection) -> None:
        """Let a fault strike what travels from now on."""
        self._bad = True
        for way in self._ways(str(injection.values.get("way", _WAYS.get(injection.fault, _BOTH)))):
            way.faults.append(injection)

    def _ways(self, which: str) -> Iterator[_Way[Data]]:
        if which in (_BOTH, _TO):
            yield self._in
        if which in (_BOTH, _FROM):
            yield self._out
