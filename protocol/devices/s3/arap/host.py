"""The PC's end of the computer link: one order at a time over an ADLP link."""

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

# Asked for with every answer, by names of this module: until Python 3.12 an enum's own name costs five times that.
_RESPONSE, _SPONTANEOUS = TelegramType.RESPONSE, TelegramType.SPONTANEOUS


class OrderFailure(StrEnum):
    """Why an order got no answer although the link did its part; the other reasons are `LinkFailure`."""

    TIME_OUT = "no answer telegram in time"
    UNFIT_ANSWER = "answer does not fit"


class Answered(NamedTuple):
    """The order was done, or the query is answered."""

    order: Telegram
    """The order as it was sent in several blocks, like `answer`."""
    answer: Telegram
    """All blocks in one: the header of the last, the data of all in order."""
    blocks: tuple[Telegram, ...]
    """The telegrams as they came, one or more."""


@dataclass(frozen=True, slots=True)
class Refused:
    """The controller refused the order."""

    order: Telegram
    refusal: Refusal


@dataclass(frozen=True, slots=True)
class OrderFailed:
    """Unknown whether the order was done: the link failed, or the answer is missing or wrong."""

    order: Telegram
    reason: LinkFailure | OrderFailure
    text: str
    remedy: str = ""
    """Checks for an operator; empty where none is known."""


@dataclass(frozen=True, slots=True)
class SpontaneousReceived:
    """The controller told something unasked."""

    spontaneous: Spontaneous


@dataclass(frozen=True, slots=True)
class UnexpectedReceived:
    """A telegram came that answers nothing and could not be understood as spontaneous."""

    raw: bytes
    text: str


ArapEvent: TypeAlias = (
    Answered | Refused | OrderFailed | SpontaneousReceived | UnexpectedReceived | LinkFailed | LinkNotice
)
"""`LinkFailed` for a message of the controller that was lost, and for an order whose ACK was lost while its answer may
come. A lost order is `OrderFailed`.
"""


class ArapHost:
    """An endpoint for bytes that takes orders and tells what became of them."""

    def __init__(self, profile: LinkProfile) -> None:
        self._profile = profile
        self.link = Link(Role.HOST, profile)
        """The data link, for its counters and state."""
        self._order: Telegram | None = None
        self._blocks: list[Telegram] = []
        self._deadline: float | None = None
        self._events: deque[ArapEvent] = deque()

    @property
    def outstanding(self) -> Telegram | None:
        """The order that has no answer yet."""
        return self._order

    def order(self, *telegrams: Telegram) -> None:
        """Send an order: one telegram, or those of a long one in order (`split_telegram`).

        Raises LocalProtocolError while another one has no answer, or when it cannot be sent; nothing is sent then.
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
                f"a controller that ends a block at the first DLE ETX cannot take this order: {order}",
            )
        self._order = order
        self._blocks.clear()

    def announce(self) -> None:
        """Bid for an order that `order` is about to be given; see `Link.announce`.

        Raises LocalProtocolError while an order has no answer.
        """
        if self._order is not None:
            raise LocalProtocolError(f"the answer to an order is outstanding: {self._order}")
        self.link.announce()

    def receive(self, data: bytes, now: float) -> None:
        """Take bytes off the line."""
        self.link.receive(data, now)
        self._take_events(now)

    def next_event(self) -> ArapEvent | None:
        """Return the oldest event not yet taken, or None."""
        return self._events.popleft() if self._events else None

    def data_to_send(self, now: float) -> bytes:
        """Bytes for the line."""
        return self.link.data_to_send(now)

    def next_deadline(self) -> float | None:
        """Return the next time-out of the link or of the order."""
        link, order = self.link.next_deadline(), self._deadline
        if link is None or order is None:
            return order if link is None else link
        return min(link, order)

    def handle_deadline(self, now: float) -> None:
        """Act on the time-outs up to now."""
        self.link.handle_deadline(now)
        self._take_events(now)
        if self._order is None or self._deadline is None or now < self._deadline:
            return
        if self.link.receiving:  # perhaps the answer, of many blocks; the link sees to it that this ends
            self._deadline = now + self._profile.order_timeout_s
            return
        self._fail(
            self._order,
            OrderFailure.TIME_OUT,
            f"no answer telegram within {self._profile.order_timeout_s:g} s to: {self._order}",
        )

    def _take_events(self, now: float) -> None:
        while (event := self.link.next_event()) is not None:
            match event:
                case MessageReceived(telegrams):
                    for raw in telegrams:
                        self._take_telegram(raw, now)
                case MessageSent():
                    self._deadline = now + self._profile.order_timeout_s
                case LinkFailed(reason, text, remedy) if (
                    reason not in INCOMING_FAILURES and self._order is not None
                ):
                    if reason is LinkFailure.INTERRUPTED:
                        # The bid that interrupted is most likely that of the answer.
                        self._deadline = now + self._profile.order_timeout_s
                        self._keep(event)
                    else:
                        self._fail(self._order, reason, text, remedy)
                case _:
                    self._keep(event)

    def _take_telegram(self, raw: bytes, now: float) -> None:
        sent_order = self._order if self._deadline is not None else None
        try:
            telegram = Telegram.decode(raw, from_robot=True)
        except RemoteProtocolError as error:
            self._take_unfit(sent_order, raw, str(error))
            return
        if telegram.type == _SPONTANEOUS:
            try:
                self._keep(SpontaneousReceived(Spontaneous.from_telegram(telegram)))
            except RemoteProtocolError as error:
                self._keep(UnexpectedReceived(raw, str(error)))
        elif sent_order is None:
            self._keep(UnexpectedReceived(raw, f"nothing was ordered, but there came: {telegram}"))
        else:
            try:
                self._take_answer(sent_order, telegram, now)
            except RemoteProtocolError as error:
                self._take_unfit(sent_order, raw, str(error))

    def _take_answer(self, order: Telegram, telegram: Telegram, now: float) -> None:
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

    def _take_unfit(self, order: Telegram | None, raw: bytes, text: str) -> None:
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
