"""PC end of the computer link. It sends one order at a time over an ADLP link."""

from collections import deque
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple, TypeAlias

from protocol.devices.s3.adlp import (
    EVENT_LIMIT,
    INCOMING_FAILURES,
    MESSAGE_LIMIT,
    TRAILER,
    Link,
    LinkFailed,
    LinkFailure,
    LinkNotice,
    LinkProfile,
    MessageReceived,
    MessageSent,
    NoticeKind,
    Role,
)
from protocol.devices.s3.arap.blocks import join_blocks
from protocol.devices.s3.arap.codes import TelegramType
from protocol.devices.s3.arap.messages import Refusal, Spontaneous
from protocol.devices.s3.arap.telegram import Telegram
from protocol.endpoint import LocalProtocolError, RemoteProtocolError

# Used with every answer, so bound to module names: before Python 3.12 an enum member lookup is five times slower.
_RESPONSE, _SPONTANEOUS = TelegramType.RESPONSE, TelegramType.SPONTANEOUS


class OrderFailure(StrEnum):
    """Reason why an order got no valid answer although the link delivered it. `LinkFailure` lists all other reasons."""

    TIME_OUT = "no answer telegram in time"
    UNFIT_ANSWER = "answer does not fit"


class Answered(NamedTuple):
    """The order was executed, or the query was answered."""

    order: Telegram
    """Order that was sent, with all blocks joined: the header of the last block, and the data of all blocks in
    order.
    """
    answer: Telegram
    """Answer with all blocks joined: the header of the last block, and the data of all blocks in order."""
    blocks: tuple[Telegram, ...]
    """Telegrams of the answer as received, at least one."""


@dataclass(frozen=True, slots=True)
class Refused:
    """The controller refused the order."""

    order: Telegram
    refusal: Refusal


@dataclass(frozen=True, slots=True)
class OrderFailed:
    """It is unknown whether the order was executed, because the link failed, or the answer is missing or wrong."""

    order: Telegram
    reason: LinkFailure | OrderFailure
    text: str
    remedy: str = ""
    """Checks that an operator should make; empty if none is known."""


@dataclass(frozen=True, slots=True)
class SpontaneousReceived:
    """The controller sent an unsolicited message."""

    spontaneous: Spontaneous


@dataclass(frozen=True, slots=True)
class UnexpectedReceived:
    """A telegram was received that is neither an answer to the order nor a valid unsolicited message."""

    raw: bytes
    text: str


ArapEvent: TypeAlias = (
    Answered | Refused | OrderFailed | SpontaneousReceived | UnexpectedReceived | LinkFailed | LinkNotice
)
"""Event of the host. `LinkFailed` reports a lost message of the controller, or an order whose ACK was lost while
its answer may still come. A lost order is reported by `OrderFailed`.
"""


class ArapHost:
    """Byte endpoint that accepts orders and reports their outcome."""

    def __init__(self, profile: LinkProfile) -> None:
        self._profile = profile
        self.link = Link(Role.HOST, profile)
        """Data link, for access to its counters and state."""
        self._order: Telegram | None = None
        self._blocks: list[Telegram] = []
        self._deadline: float | None = None
        self._events: deque[ArapEvent] = deque()

    @property
    def outstanding(self) -> Telegram | None:
        """Order that has not been answered yet, or None."""
        return self._order

    def order(self, *telegrams: Telegram) -> None:
        """Send an order: one telegram, or the telegrams of a long order in sequence (`split_telegram`).

        Raises LocalProtocolError if another order has not been answered yet, or if the order cannot be sent.
        Nothing is sent then.
        """
        if self._order is not None:
            raise LocalProtocolError(f"the answer to an order is outstanding: {self._order}")
        try:
            order = join_blocks(telegrams)
        except RemoteProtocolError as error:
            raise LocalProtocolError(str(error)) from error
        raws = [telegram.encode(self._profile.length_style) for telegram in telegrams]
        self.link.send(raws)
        if self._profile.dle_stuffing == "off" and any(TRAILER in raw for raw in raws):
            self.link.note(
                NoticeKind.TRAILER_SENT,
                f"a controller that ends a block at the first DLE ETX cannot receive this order: {order}",
            )
        self._order = order
        self._blocks.clear()

    def announce(self) -> None:
        """Bid for an order that will be passed to `order` shortly; see `Link.announce`.

        Raises LocalProtocolError if an order has not been answered yet.
        """
        if self._order is not None:
            raise LocalProtocolError(f"the answer to an order is outstanding: {self._order}")
        self.link.announce()

    def receive(self, data: bytes, now: float) -> None:
        """Process received bytes."""
        self.link.receive(data, now)
        self._process_events(now)

    def next_event(self) -> ArapEvent | None:
        """Return the oldest event not yet taken, or None."""
        return self._events.popleft() if self._events else None

    def data_to_send(self, now: float) -> bytes:
        """Return the bytes to send."""
        return self.link.data_to_send(now)

    def next_deadline(self) -> float | None:
        """Return the time of the next time-out of the link or of the order, s."""
        link, order = self.link.next_deadline(), self._deadline
        if link is None or order is None:
            return order if link is None else link
        return min(link, order)

    def handle_deadline(self, now: float) -> None:
        """Handle all time-outs up to `now`."""
        self.link.handle_deadline(now)
        self._process_events(now)
        if self._order is None or self._deadline is None or now < self._deadline:
            return
        if self.link.receiving:  # possibly the answer, in many blocks; the link bounds its duration
            self._deadline = now + self._profile.order_timeout_s
            return
        self._fail(
            self._order,
            OrderFailure.TIME_OUT,
            f"no answer telegram within {self._profile.order_timeout_s:g} s to: {self._order}",
        )

    def _process_events(self, now: float) -> None:
        while (event := self.link.next_event()) is not None:
            match event:
                case MessageReceived(telegrams):
                    for raw in telegrams:
                        self._process_telegram(raw, now)
                case MessageSent():
                    self._deadline = now + self._profile.order_timeout_s
                case LinkFailed(reason, text, remedy) if (
                    reason not in INCOMING_FAILURES and self._order is not None
                ):
                    if reason is LinkFailure.INTERRUPTED:
                        # The bid that interrupted us most likely precedes the answer.
                        self._deadline = now + self._profile.order_timeout_s
                        self._keep(event)
                    else:
                        self._fail(self._order, reason, text, remedy)
                case _:
                    self._keep(event)

    def _process_telegram(self, raw: bytes, now: float) -> None:
        sent_order = self._order if self._deadline is not None else None
        try:
            telegram = Telegram.decode(raw, from_robot=True)
        except RemoteProtocolError as error:
            self._process_unmatched(sent_order, raw, str(error))
            return
        if telegram.type == _SPONTANEOUS:
            try:
                self._keep(SpontaneousReceived(Spontaneous.from_telegram(telegram)))
            except RemoteProtocolError as error:
                self._keep(UnexpectedReceived(raw, str(error)))
        elif sent_order is None:
            self._keep(UnexpectedReceived(raw, f"received without an outstanding order: {telegram}"))
        else:
            try:
                self._process_answer(sent_order, telegram, now)
            except RemoteProtocolError as error:
                self._process_unmatched(sent_order, raw, str(error))

    def _process_answer(self, order: Telegram, telegram: Telegram, now: float) -> None:
        if telegram.function != order.function:
            raise RemoteProtocolError(f"the answer is to another order: {telegram}")
        if telegram.type == _RESPONSE:
            blocks = (*self._blocks, telegram)
            self._end(Answered(order, join_blocks(blocks), blocks))
            return
        match telegram.type:
            case TelegramType.REFUSAL:
                self._end(Refused(order, Refusal.from_telegram(telegram)))
            case TelegramType.FURTHER_FROM_ROBOT:
                if len(self._blocks) >= MESSAGE_LIMIT:
                    raise RemoteProtocolError(f"the answer has more than {MESSAGE_LIMIT} blocks")
                self._blocks.append(telegram)
                self._deadline = now + self._profile.order_timeout_s
            case _:
                raise RemoteProtocolError(f"no answer has this type: {telegram}")

    def _process_unmatched(self, order: Telegram | None, raw: bytes, text: str) -> None:
        if order is None:
            self._keep(UnexpectedReceived(raw, text))
        else:
            self._fail(order, OrderFailure.UNFIT_ANSWER, f"{text} (order: {order})")

    def _fail(self, order: Telegram, reason: LinkFailure | OrderFailure, text: str, remedy: str = "") -> None:
        self._end(OrderFailed(order, reason, text, remedy))

    def _end(self, event: Answered | Refused | OrderFailed) -> None:
        self._order = None
        self._deadline = None
        self._blocks.clear()
        self._keep(event)

    def _keep(self, event: ArapEvent) -> None:
        if len(self._events) >= EVENT_LIMIT:
            self._events.popleft()
        self._events.append(event)
