"""A bad wire: a filter between a device and its wire, for bytes or for frames."""

import random
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from emulators.faults.kinds import FOREVER, Fault, Parameter
from emulators.faults.ledger import Handler, Injection
from protocol.can.frame import CanFrame

Data = TypeVar("Data", bound=Sequence[Any])

_BOTH, _TO, _FROM = "both", "to", "from"
_WAY = Parameter(_BOTH, "what travels to the device, from it, or both", choices=(_BOTH, _TO, _FROM))


def _probability(default: float) -> Parameter:
    return Parameter(default, "of each byte or frame", 0.0, 1.0)


WIRE_FAULTS: Mapping[str, Fault] = {
    "off": Fault("the cable is cut: nothing arrives", {"way": _WAY}, 2.0),
    "loss": Fault("some is lost", {"probability": _probability(0.05), "way": _WAY}, FOREVER),
    "corruption": Fault("one bit is turned over", {"probability": _probability(0.02), "way": _WAY}, FOREVER),
    "garbage": Fault(
        "random bytes come in place of what was sent", {"probability": _probability(1.0), "way": _WAY}, 1.0
    ),
    "duplication": Fault("some comes twice", {"probability": _probability(0.05), "way": _WAY}, FOREVER),
    "delay": Fault(
        "everything comes later",
        {"ms": Parameter(100.0, "by how much", 0.0, 10000.0, "ms"), "way": _WAY},
        FOREVER,
    ),
    "lose-next": Fault(
        "the next bytes or frames from the device are lost", {"count": Parameter(20, "how many", 1, 10000)}
    ),
}
"""Faults of every wire."""


@dataclass(frozen=True, slots=True)
class Pieces(Generic[Data]):
    """How a wire's data are taken apart."""

    join: Callable[[list[Any]], Data]
    """Pieces to data."""
    corrupt: Callable[[Any, random.Random], Any]
    """A piece with one bit turned over."""
    garble: Callable[[Any, random.Random], Any]
    """A piece with other contents."""


def _with(frame: CanFrame, data: bytes) -> CanFrame:
    return CanFrame(frame.identifier, data, frame.extended, frame.remote, frame.error)


def _corrupt_frame(frame: CanFrame, draw: random.Random) -> CanFrame:
    bit = draw.randrange(8 * max(len(frame.data), 1))
    data = bytearray(frame.data)
    if data:
        data[bit // 8] ^= 1 << bit % 8
    return _with(frame, bytes(data))


BYTES: Pieces[bytes] = Pieces(
    bytes, lambda byte, draw: byte ^ 1 << draw.randrange(8), lambda byte, draw: draw.randrange(256)
)
FRAMES: Pieces[Sequence[CanFrame]] = Pieces(
    list[CanFrame], _corrupt_frame, lambda frame, draw: _with(frame, draw.randbytes(len(frame.data)))
)


def _corrupt_datagram(datagram: bytes, draw: random.Random) -> bytes:
    data = bytearray(datagram)
    if data:
        bit = draw.randrange(8 * len(data))
        data[bit // 8] ^= 1 << bit % 8
    return bytes(data)


DATAGRAMS: Pieces[Sequence[bytes]] = Pieces(
    list[bytes], _corrupt_datagram, lambda datagram, draw: draw.randbytes(len(datagram))
)


class _Way(Generic[Data]):
    """One direction, with draws of its own: so that neither direction depends on the traffic of the other."""

    def __init__(self, pieces: Pieces[Data], draw: random.Random) -> None:
        self._pieces = pieces
        self._draw = draw
        self.faults: list[Injection] = []
        self.under_way: deque[tuple[float, Data]] = deque()
        """Late data, each with the time at which they come, s."""

    def take(self, data: Data, now: float) -> None:
        """Let data begin their way."""
        late = 0.0
        pieces: list[Any] = list(data)
        for injection in self.faults:
            if not injection.holds(now) or not pieces:
                continue
            if injection.fault == "delay":
                late += injection.number("ms") * 1e-3
                injection.struck += len(pieces)
            else:
                pieces = self._damaged(pieces, injection, now)
        if pieces:
            at = now + late
            if self.under_way:
                at = max(at, self.under_way[-1][0])
            self.under_way.append((at, self._pieces.join(pieces)))

    def arrived(self, now: float) -> Data:
        """Data that have come through by now."""
        found: list[Any] = []
        while self.under_way and self.under_way[0][0] <= now:
            found += self.under_way.popleft()[1]
        return self._pieces.join(found)

    def _damaged(self, pieces: list[Any], injection: Injection, now: float) -> list[Any]:
        """The pieces that are left, damaged or not."""
        fault, draw = injection.fault, self._draw
        if fault == "off":
            injection.struck += len(pieces)
            return []
        if fault == "lose-next":
            lost = min(len(pieces), int(injection.number("count")) - injection.struck)
            injection.struck += lost
            if injection.struck >= injection.number("count"):
                injection.finish(now)
            return pieces[lost:]
        probability = injection.number("probability")
        out: list[Any] = []
        for piece in pieces:
            if draw.random() >= probability:
                out.append(piece)
                continue
            injection.struck += 1
            if fault == "corruption":
                out.append(self._pieces.corrupt(piece, draw))
            elif fault == "garbage":
                out.append(self._pieces.garble(piece, draw))
            elif fault == "duplication":
                out += (piece, piece)
        return out


class FaultyWire(Generic[Data]):
    """The wire of one device. The device passes everything through it while it is `bad`."""

    def __init__(self, pieces: Pieces[Data], seed: int | str) -> None:
        self._in: _Way[Data] = _Way(pieces, random.Random(f"{seed} to the device"))
        self._out: _Way[Data] = _Way(pieces, random.Random(f"{seed} from the device"))
        self.bad = False
        """Whether a fault is, or was, on it: then something may still be under way."""
        self.handlers: Mapping[str, Handler] = {name: Handler(self.begin) for name in WIRE_FAULTS}
        """Handlers for a ledger."""

    def incoming(self, data: Data, now: float) -> Data:
        """Take data sent to the device; those, of them or of earlier ones, that it receives now."""
        self._in.take(data, now)
        return self._in.arrived(now)

    def outgoing(self, data: Data, now: float) -> Data:
        """Take data that the device sends; those, of them or of earlier ones, that come out now."""
        if len(data):
            self._out.take(data, now)
        return self._out.arrived(now)

    def arrived(self, now: float) -> Data:
        """Late data that the device receives now."""
        return self._in.arrived(now)

    def next_deadline(self, other: float | None) -> float | None:
        """When something late comes through, or `other` if that is earlier."""
        for way in (self._in, self._out):
            if way.under_way and (other is None or way.under_way[0][0] < other):
                other = way.under_way[0][0]
        return other

    def begin(self, injection: Injection) -> None:
        """Let a fault strike what travels from now on."""
        self.bad = True
        for way in self._ways(str(injection.values.get("way", _FROM))):
            way.faults.append(injection)

    def _ways(self, which: str) -> Iterator[_Way[Data]]:
        if which in (_BOTH, _TO):
            yield self._in
        if which in (_BOTH, _FROM):
            yield self._out
