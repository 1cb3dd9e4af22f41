"""The datagrams of a controller as faults let them through."""

from collections.abc import Mapping, Sequence

from emulators.faults.ledger import Handler, Injection
from emulators.faults.own import OwnFaults
from emulators.faults.wire import DATAGRAMS, FaultyWire
from protocol.devices.egm import RobotMessage

_CUT_BYTES = 7
"""Chosen: bytes that a datagram lacks which comes cut off."""


class BadLink:
    """A filter between a controller and its wire; without a fault all passes at once."""

    def __init__(self, seed: int) -> None:
        self._wire: FaultyWire[Sequence[bytes]] = FaultyWire(DATAGRAMS, f"{seed} egm")
        self._own = OwnFaults()
        self.handlers: Mapping[str, Handler] = {
            **self._wire.handlers,
            **self._own.held(("mute", "deaf", "wrong-seqno", "malformed", "no-force")),
        }

    def incoming(self, data: Sequence[bytes], now: float) -> Sequence[bytes]:
        """Datagrams that reach the controller now."""
        if data and self._own.under_way("deaf", now) is not None:
            data = []
        return self._wire.incoming(data, now) if self._wire.bad else data

    def outgoing(self, data: Sequence[bytes], now: float) -> Sequence[bytes]:
        """Datagrams that leave the controller now."""
        return self._wire.outgoing(data, now) if self._wire.bad else data

    def next_deadline(self, other: float | None) -> float | None:
        """When something late comes through, or `other` if that is earlier."""
        return self._wire.next_deadline(other) if self._wire.bad else other

    def altered(self, message: RobotMessage, now: float) -> RobotMessage | None:
        """A message as it is told; None where it is not."""
        if self._own.under_way("mute", now) is not None:
            return None
        if (wrong := self._own.under_way("wrong-seqno", now)) is not None:
            _finish_counted(wrong, now)
            message = message._replace(seqno=message.seqno + int(wrong.number("by")))
        if self._own.under_way("no-force", now) is not None:
            message = message._replace(force=(), force_control=None)
        return message

    def cut(self, datagram: bytes, now: float) -> bytes:
        """A datagram, whole or not."""
        if (cut := self._own.under_way("malformed", now)) is None:
            return datagram
        _finish_counted(cut, now)
        return datagram[:-_CUT_BYTES]


def _finish_counted(injection: Injection, now: float) -> None:
    """End a fault that has had as many effects as it was to have."""
    if injection.struck >= injection.number("count"):
        injection.finish(now)
