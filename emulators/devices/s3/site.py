"""Site-specific contents of a controller: programs with their steps, and orders that only this site defines."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

from protocol.devices.s3.arap import KNOWN, OrderBook, OrderDefinition, RefusalCode, Telegram, Value, response
from protocol.endpoint import LocalProtocolError

PLACE_LIMIT = 65536
"""Maximum total number of stored entries in all memories, so that no host can exhaust this computer's memory. Mark:
chosen.
"""

_Place: TypeAlias = tuple[str, tuple[Value, ...]]


@dataclass(frozen=True, slots=True)
class S3Site:
    """Site-specific contents of a controller."""

    orders: OrderBook = KNOWN
    """Orders that the site defines."""
    programs: Mapping[int, bytes] = field(default_factory=dict)
    """Programs that can be received and started, by number."""


EMPTY_SITE = S3Site()
"""Site without programs and orders of its own."""


class SiteOrders:
    """Answers to the orders that a site defines. A value that is written to a memory can be read from it."""

    def __init__(self, book: OrderBook) -> None:
        self._book = book
        self._places: dict[_Place, dict[str, Value]] = {}

    def answer(self, definition: OrderDefinition, order: Telegram) -> Telegram | RefusalCode:
        """Return the answer to an order of sufficient length.

        Assumed: refusal code 10 if the number of entries would exceed the limit, 31 if a value does not fit the
        answer.
        """
        emulation = definition.emulation
        fields = definition.order.decode(order.data)
        stored: dict[str, Value] = {}
        if emulation.memory:
            place = emulation.memory, tuple(fields[name] for name in emulation.key)
            written = {name: value for name, value in fields.items() if name not in emulation.key}
            stored = {**self._places.get(place, {}), **written}
            if written and place not in self._places and len(self._places) >= PLACE_LIMIT:
                return RefusalCode.NO_SPACE_LEFT
            if written:
                self._places[place] = stored
        known = {**emulation.initial, **stored, **fields}
        values = {name: known[name] for name in definition.answer.names if name in known}
        try:
            return response(order, definition.answer.encode(values))
        except LocalProtocolError:
            return RefusalCode.NOT_POSSIBLE

    def extend(self, order: Telegram, answer: Telegram) -> Telegram | RefusalCode:
        """Return the answer to an order with a known payload, extended by the fields that the site adds."""
        extension = self._book.extension_of(order.function)
        if extension is None:
            return answer
        more = self.answer(extension, order)
        if isinstance(more, RefusalCode):
            return more
        size = max(len(answer.data), len(more.data))
        known, added = answer.data.ljust(size, b"\0"), more.data.ljust(size, b"\0")
        return response(order, bytes(a | b for a, b in zip(known, added, strict=True)))
