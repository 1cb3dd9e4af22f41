"""Catalogue of all orders known on one link: the orders of the specification and the orders that the site defines."""

import difflib
from collections.abc import Sequence
from dataclasses import dataclass

from protocol.devices.s3.arap import layouts
from protocol.devices.s3.arap.codes import FunctionCode, TelegramType, plain_type, refusal_text, suffix_text
from protocol.devices.s3.arap.orders import (
    KNOWN_ORDERS,
    DefinitionError,
    OrderDefinition,
    check_definition,
    merged,
)
from protocol.devices.s3.arap.payload import Payload, describe_rest
from protocol.devices.s3.arap.telegram import Telegram
from protocol.endpoint import LocalProtocolError

_KNOWN_FUNCTIONS = {definition.function: definition for definition in KNOWN_ORDERS}
_REFUSAL = Payload(layouts.REFUSAL)
_SPONTANEOUS = Payload(layouts.SPONTANEOUS)


@dataclass(frozen=True, slots=True)
class TelegramText:
    """Description of a telegram's data for display."""

    fields: list[dict[str, object]]
    """Descriptions of all fields, as returned by `Layout.describe`."""
    remark: str = ""
    """Meaning of the complete data; empty if there is none."""


class OrderBook:
    """Definitions of orders by name and by function code.

    Raises DefinitionError for an invalid or duplicate definition. The error's path starts with the name of the
    order.
    """

    def __init__(self, site: Sequence[OrderDefinition] = (), max_telegram: int = 0xFFFF) -> None:
        self.site = tuple(site)
        """Definitions that the site has added."""
        self._by_function = dict(_KNOWN_FUNCTIONS)
        self._by_name = {definition.name: definition for definition in KNOWN_ORDERS}
        self._extensions: dict[int, OrderDefinition] = {}
        names: dict[int, str] = {}
        for definition in self.site:
            try:
                check_definition(definition, max_telegram)
            except DefinitionError as error:
                raise DefinitionError(str(error), definition.name, *error.path) from error
            if (other := names.setdefault(definition.function, definition.name)) != definition.name:
                raise DefinitionError(
                    f"{definition.function} is already the function of {other}", definition.name, "function"
                )
            if definition.extends:
                self._extensions[definition.function] = definition
            order = merged(definition) if definition.extends else definition
            self._by_function[definition.function] = order
            self._by_name[definition.name] = order

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all orders that can be called."""
        return tuple(self._by_name)

    def named(self, name: str) -> OrderDefinition:
        """Return the order with this name. If there is none, raise LocalProtocolError that names a similar order or
        all known ones.
        """
        definition = self._by_name.get(name)
        if definition is None:
            close = difflib.get_close_matches(name, self._by_name, 1)
            hint = f"did you mean {close[0]}?" if close else f"there are {', '.join(self._by_name)}"
            raise LocalProtocolError(f"unknown order {name!r}; {hint}")
        return definition

    def of_function(self, function: int) -> OrderDefinition | None:
        """Return the order with this function code, including the site's extension, or None."""
        return self._by_function.get(function)

    def extension_of(self, function: int) -> OrderDefinition | None:
        """Return the site's extension of a known order, with only its additional fields, or None."""
        return self._extensions.get(function)

    def payloads_of(self, function: int, type_: int) -> tuple[Payload, ...]:
        """Return the possible layouts of a telegram's data, the most detailed first; empty if none is known."""
        type_ = plain_type(type_)
        if type_ == TelegramType.REFUSAL:
            return (_REFUSAL,)
        if (function, type_) == (FunctionCode.SPONTANEOUS, TelegramType.SPONTANEOUS):
            return (_SPONTANEOUS,)
        payloads = [self._by_function[function]] if function in self._by_function else []
        if function in self._extensions:
            payloads.append(_KNOWN_FUNCTIONS[function])
        if type_ in (TelegramType.ORDER, TelegramType.FURTHER_FROM_PC):
            return tuple(definition.order for definition in payloads)
        if type_ in (TelegramType.RESPONSE, TelegramType.FURTHER_FROM_ROBOT):
            return tuple(definition.answer for definition in payloads)
        return ()

    def suffix_text(self, function: int, suffix: int) -> str:
        """Return the meaning of a function suffix; empty if it is unknown."""
        definition = self._by_function.get(function)
        meaning = definition.suffixes.get(suffix, "") if definition else ""
        return meaning or suffix_text(function, suffix)

    def describe(self, telegram: Telegram, continued: bool = False) -> TelegramText:
        """Describe the data of a telegram. `continued` says that an earlier block of the same telegram precedes it.

        Raises RemoteProtocolError if the data is too short.
        """
        payloads = self.payloads_of(telegram.function, telegram.type)
        if not payloads:
            return TelegramText([])
        if continued:
            rest = payloads[0].rest
            return TelegramText([describe_rest(rest, telegram.data)] if rest else [])
        for payload in payloads[:-1]:
            if len(telegram.data) >= payload.layout.size:
                return TelegramText(payload.describe(telegram.data))
        fields = payloads[-1].describe(telegram.data)
        if payloads[-1] is not _REFUSAL:
            return TelegramText(fields)
        return TelegramText(fields, refusal_text(int(_REFUSAL.layout.unpack(telegram.data)["code"])))


KNOWN = OrderBook()
"""Catalogue with only the orders of the specification."""
