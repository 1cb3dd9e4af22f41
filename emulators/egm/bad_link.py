"""The datagrams of a controller as faults let them through."""

import random
from collections.abc import Mapping, Sequence

from emulators.faults.ledger import Handler, Injection
from emulators.faults.wire import FaultyWire, Pieces
from protocol.egm import RobotMessage

_CUT_BYTES = 7
"""Chosen: bytes that a datagram lacks which comes cut off."""


def _flip(datagram: bytes, draw: random.Random) -> bytes:
    bit = draw.randrange(8 * max(len(datagram), 1))
    data = bytearray(datagram)
    if data:
        data[bit // 8] ^= 1 << bit % 8
    return bytes(data)


DATAGRAMS: Pieces[Sequence[bytes]] = Pieces(
    list[bytes], _flip, lambda datagram, draw: draw.randbytes(len(datagram))
)


class BadLink:
    """A filter between a controller and its wire; without a fault all passes at once."""

    def __init__(self, seed: int) -> None:
        self._wire: FaultyWire[Sequence[bytes]] = FaultyWire(DATAGRAMS, f"{seed} egm")
        self._faults: list[Injection] = []
        own = ("mute", "deaf", "wrong-seqno", "malformed", "no-force")
        self.handlers: Mapping[str, Handler] = {
            **self._wire.handlers,
            **dict.fromkeys(own, Handler(self._faults.append)),
        }

    def incoming(self, data: Sequence[bytes], now: float) -> Sequence[bytes]:
        """What comes to the controller now."""
        if (deaf := self._under_way("deaf", now)) is not None:
            deaf.struck += len(data)
            data = []
        return self._wire.incoming(data, now) if self._wire.bad else data

    def outgoing(self, data: Sequence[bytes], now: float) -> Sequence[bytes]:
        """What comes out of the controller now."""
        return self._wire.outgoing(data, now) if self._wire.bad else data

    def next_deadline(self, other: float | None) -> float | None:
        """When something late comes through, or `other` if that is earlier."""
        return self._wire.next_deadline(other) if self._wire.bad else other

    def altered(self, message: RobotMessage, now: float) -> RobotMessage | None:
        """A message as it is told; None where it is not."""
        if (mute := self._under_way("mute", now)) is not None:
            mute.struck += 1
            return None
        if (wrong := self._under_way("wrong-seqno", now)) is not None:
            self._strike(wrong, now)
            message = message._replace(seqno=message.seqno + int(wrong.number("by")))
        if (without := self._under_way("no-force", now)) is not None:
            without.struck += 1
            message = message._replace(force=(), force_control=None)
        return message

    def cut(self, datagram: bytes, now: float) -> bytes:
        """A datagram, whole or not."""
        if (cut := self._under_way("malformed", now)) is None:
            return datagram
        self._strike(cut, now)
        return datagram[:-_CUT_BYTES]

    def _under_way(self, fault: str, now: float) -> Injection | None:
        if not self._faults:
            return None
        return next((one for one in self._faults if one.fault == fault and one.holds(now)), None)

    @staticmethod
    def _strike(injection: Injection, now: float) -> None:
        injection.struck += 1
        if injection.struck >= injection.number("count"):
            injection.finish(now)
