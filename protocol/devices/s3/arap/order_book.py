"""All orders that are known on one link: those of the specification and those of the site."""

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
    """A telegram's data for people to read."""

    fields: list[dict[str, object]]
    """Every field as `Layout.describe` tells it."""
    remark: str = ""
    """Meaning of the data as a whole."""


class OrderBook:
    """Definitions of orders by name and by function code.

    Raises DefinitionError for a definition that cannot be or comes twice; its path begins with the order's name.
    """

    def __init__(self, site: Sequence[OrderDefinition] = (), max_telegram: int = 0xFFFF) -> None:
        self.site = tuple(site)
        """Additions of the site."""
        self._by_function = dict(_KNOWN_FUNCTIONS)
        self._by_name = {definition.name: definition for definition in KNOWN_ORDERS}
        self._extensions: dict[int, OrderDefinition] = {}
        seen: dict[int, str] = {}
        for definition in self.site:
            try:
                check_definition(definition, max_telegram)
            except DefinitionError as error:
                raise DefinitionError(str(error), definition.name, *error.path) from error
            if (other := seen.setdefault(definition.function, definition.name)) != definition.name:
                raise DefinitionError(
                    f"{definition.function} is the function of {other} already", definition.name, "function"
                )
            if definition.extends:
                self._extensions[definition.function] = definition
            whole = merged(definition) if definition.extends else definition
            self._by_function[definition.function] = whole
            self._by_name[definition.name] = whole

    @property
    def names(self) -> tuple[str, ...]:
        """Every order that can be called by its name."""
        return tuple(self._by_name)

    def named(self, name: str) -> OrderDefinition:
        """Return the order of this name. Raises LocalProtocolError with the known names."""
        definition = self._by_name.get(name)
        if definition is None:
            close = difflib.get_close_matches(name, self._by_name, 1)
            hint = f"did you mean {close[0]}?" if close else f"there are {', '.join(self._by_name)}"
            raise LocalProtocolError(f"there is no order {name!r}; {hint}")
        return definition

    def of_function(self, function: int) -> OrderDefinition | None:
        """Return the order with this function code, extended where the site does so, or None."""
        return self._by_function.get(function)

    def extension_of(self, function: int) -> OrderDefinition | None:
        """Additions of the site to a known order: its additional fields alone, or None."""
        return self._extensions.get(function)

    def payloads_of(self, function: int, type_: int) -> tuple[Payload, ...]:
        """Possible layouts of a telegram's data, the most detailed first; none where nothing is known."""
        type_ = plain_type(type_)
        if type_ == TelegramType.REFUSAL:
            return (_REFUSAL,)
        if (function, type_) == (FunctionCode.SPONTANEOUS, TelegramType.SPONTANEOUS):
            return (_SPONTANEOUS,)
        found = [self._by_function[function]] if function in self._by_function else []
        if function in self._extensions:
            found.append(_KNOWN_FUNCTIONS[function])
        if type_ in (TelegramType.ORDER, TelegramType.FURTHER_FROM_PC):
            return tuple(definition.order for definition in found)
        if type_ in (TelegramType.RESPONSE, TelegramType.FURTHER_FROM_ROBOT):
            return tuple(definition.answer for definition in found)
        return ()

    def suffix_text(self, function: int, suffix: int) -> str:
        """Meaning of a function suffix; empty where none is known."""
        definition = self._by_function.get(function)
        meaning = definition.suffixes.get(suffix, "") if definition else ""
        return meaning or suffix_text(function, suffix)

    def describe(self, telegram: Telegram, continued: bool = False) -> TelegramText:
        """Describe the data. `continued`: an earlier block of the same telegram came before.

        Raises RemoteProtocolError when the data are too short for what they should be.
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
"""The orders of the specification alone."""
