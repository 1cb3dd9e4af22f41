"""A site's own contents of a controller: programs with their steps, and orders that only this site knows."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

from protocol.devices.s3.arap import KNOWN, OrderBook, OrderDefinition, RefusalCode, Telegram, Value, response
from protocol.endpoint import LocalProtocolError

PLACE_LIMIT = 65536
"""Places of all memories together that are kept, so that no host can fill ours. Mark: chosen."""

_Place: TypeAlias = tuple[str, tuple[Value, ...]]


@dataclass(frozen=True, slots=True)
class S3Site:
    """Contents of one controller."""

    orders: OrderBook = KNOWN
    """Orders that are answered."""
    programs: Mapping[int, bytes] = field(default_factory=dict)
    """Programs that can be received, by number; they can be started as well."""


EMPTY_SITE = S3Site()
"""No programs and orders beside those of every controller."""


class SiteOrders:
    """Answers to the orders that a site defines: a value that was written into a memory is read from it."""

    def __init__(self, book: OrderBook) -> None:
        self._book = book
        self._places: dict[_Place, dict[str, Value]] = {}

    def answer(self, definition: OrderDefinition, order: Telegram) -> Telegram | RefusalCode:
        """Return the answer to an order that is long enough.

        Assumed: 10 refuses one place more than is kept, 31 a value that the answer cannot hold.
        """
        emulation = definition.emulation
        given = definition.order.decode(order.data)
        stored: dict[str, Value] = {}
        if emulation.memory:
            place = emulation.memory, tuple(given[name] for name in emulation.key)
            written = {name: value for name, value in given.items() if name not in emulation.key}
            stored = {**self._places.get(place, {}), **written}
            if written and place not in self._places and len(self._places) >= PLACE_LIMIT:
                return RefusalCode.NO_SPACE_LEFT
            if written:
                self._places[place] = stored
        known = {**emulation.initial, **stored, **given}
        values = {name: known[name] for name in definition.answer.names if name in known}
        try:
            return response(order, definition.answer.encode(values))
        except LocalProtocolError:
            return RefusalCode.NOT_POSSIBLE

    def extend(self, order: Telegram, answer: Telegram) -> Telegram | RefusalCode:
        """Return the answer to an order with a known payload, with the fields that the site adds to it."""
        extension = self._book.extension_of(order.function)
        if extension is None:
            return answer
        more = self.answer(extension, order)
        if isinstance(more, RefusalCode):
            return more
        size = max(len(answer.data), len(more.data))
        known, added = answer.data.ljust(size, b"\0"), more.data.ljust(size, b"\0")
        return response(order, bytes(a | b for a, b in zip(known, added, strict=True)))
