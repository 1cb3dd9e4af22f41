"""PC side of a link whose settings are unknown. It sends one query after another, each with its own settings."""

from collections import deque
from dataclasses import dataclass
from typing import TypeAlias

from hil_bridge.device_commands.s3.search import Outcome, Query, Reply, Try
from hil_bridge.transports import LineSettings, Parity
from protocol.devices.s3.adlp import Control, LinkFailure, LinkProfile
from protocol.devices.s3.arap import (
    Answered,
    ArapHost,
    OrderFailed,
    OrderFailure,
    Refused,
    SpontaneousReceived,
    Status,
    Telegram,
)
from protocol.endpoint import RemoteProtocolError

_REPLIES: dict[LinkFailure | OrderFailure, Reply] = {
    LinkFailure.NO_ANSWER: Reply.SILENCE,
    LinkFailure.ONLY_NOISE: Reply.NOISE,
    LinkFailure.BID_REFUSED: Reply.BID_REFUSED,
    LinkFailure.REPEATS_EXHAUSTED: Reply.BLOCK_REFUSED,
    LinkFailure.WACK_LIMIT: Reply.BLOCK_REFUSED,
    LinkFailure.ABORTED: Reply.BLOCK_REFUSED,
    OrderFailure.TIME_OUT: Reply.UNREADABLE,
    OrderFailure.UNFIT_ANSWER: Reply.UNREADABLE,
}


_PLAIN = (Reply.SILENCE, Reply.NOISE)
"""Replies that are displayed without details."""


@dataclass(frozen=True, slots=True)
class UnsolicitedMessage:
    """Unsolicited message of the controller that was acknowledged."""

    text: str


ProbeEvent: TypeAlias = Outcome | UnsolicitedMessage


class Prober:
    """Endpoint for bytes. `ask` begins a query, and an `Outcome` among its events ends the query.

    Unsolicited messages of the controller are received and acknowledged with the settings of the newest query.
    """

    def __init__(self) -> None:
        self._host = ArapHost(LinkProfile())
        self._events: deque[ProbeEvent] = deque()

    def ask(self, query: Query, profile: LinkProfile) -> None:
        """Send a query with these settings. An earlier query is discarded."""
        self._host = ArapHost(profile)
        self._host.order(query.value)

    def receive(self, data: bytes, now: float) -> None:
        """Process received bytes."""
        self._host.receive(data, now)
        self._take()

    def next_event(self) -> ProbeEvent | None:
        """Return the oldest pending event, or None."""
        return self._events.popleft() if self._events else None

    def data_to_send(self, now: float) -> bytes:
        """Return bytes for the line."""
        return self._host.data_to_send(now)

    def next_deadline(self) -> float | None:
        """Return the time of the link's next time-out, s."""
        return self._host.next_deadline()

    def handle_deadline(self, now: float) -> None:
        """Handle all time-outs up to now."""
        self._host.handle_deadline(now)
        self._take()

    def _take(self) -> None:
        while (event := self._host.next_event()) is not None:
            match event:
                case Answered(answer=answer, blocks=blocks):
                    holds_dle = any(Control.DLE in block.encode() for block in blocks)
                    self._events.append(Outcome(Reply.ANSWERED, _status_text(answer), holds_dle))
                case Refused(refusal=refusal):
                    self._events.append(Outcome(Reply.REFUSED, f"{refusal.code} {refusal.text}"))
                case OrderFailed(reason=reason, text=text):
                    # an interrupted order is still awaited, so this is never its reason
                    reply = _REPLIES[reason]
                    self._events.append(Outcome(reply, "" if reply in _PLAIN else text))
                case SpontaneousReceived(spontaneous=spontaneous):
                    self._events.append(UnsolicitedMessage(spontaneous.text))


def _status_text(answer: Telegram) -> str:
    try:
        status = Status.from_telegram(answer)
    except RemoteProtocolError as error:
        return f"{answer}: {error}"
    x, y, z = (round(value * 1e3, 3) for value in status.position)
    return f"at {x:g}, {y:g}, {z:g} mm, {_state(status)}"


def _state(status: Status) -> str:
    states = {
        "emergency stop": status.emergency_stop,
        "operation": status.operation,
        "standby": status.standby,
        "executing": status.execution,
        "local": status.local,
    }
    return ", ".join(name for name, holds in states.items() if holds) or "no flag set"


def profile_of(attempt: Try, patience: float, answer_patience: float) -> LinkProfile:
    """Return the link settings for a try. They allow one repeat, so that wrong settings fail fast.

    `patience` is the longest wait for an ACK, s; `answer_patience` is the longest wait for the answer telegram, s.
    """
    line = attempt.line or LineSettings(parity=Parity.EVEN)
    return LinkProfile(
        baudrate=line.baudrate,
        parity=line.parity.value,
        stop_bits=1 if line.stopbits == 1 else 2,
        dle_stuffing=attempt.dle_stuffing,
        length_style=attempt.length_style,
        answer_timeout_s=patience,
        order_timeout_s=answer_patience,
        bid_limit=attempt.bids,
        repeat_limit=1,
    )
