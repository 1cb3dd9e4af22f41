"""Subscriptions of Robot Web Services 1.0: what has changed since a subscriber was told last.

Nothing is queued. A value that changed twice between two looks is told once, with its newest value.
"""

from collections.abc import Callable, Sequence

from emulators.devices.egm.web_documents import Item, write_xhtml

GROUPS_MAX = 64
"""Chosen: subscriptions at a time."""
RESOURCES_MAX = 64
"""Chosen: resources of one subscription; more are left out."""


class Subscriptions:
    """All subscriptions of a controller, by number."""

    def __init__(self, look: Callable[[str], Item]) -> None:
        """`look` gives the event that tells a resource's present value."""
        self._look = look
        self._groups: dict[str, dict[str, Item]] = {}
        """The newest event of each resource, by number of the subscription."""
        self._begun = 0

    def begin(self, resources: Sequence[str]) -> str | None:
        """Begin one at the present values; its number, or None where there are as many as may be."""
        if len(self._groups) >= GROUPS_MAX:
            return None
        self._begun += 1
        self._groups[f"{self._begun}"] = {one: self._look(one) for one in resources[:RESOURCES_MAX]}
        return f"{self._begun}"

    def end(self, number: str) -> bool:
        """End one; whether there was such."""
        return self._groups.pop(number, None) is not None

    def knows(self, number: str) -> bool:
        """Whether there is such a subscription."""
        return number in self._groups

    def news(self, number: str) -> bytes:
        """Return the document of what has changed since the last one; empty if nothing has."""
        told = self._groups.get(number, {})
        changed = [event for one in told if (event := self._look(one)) != told[one]]
        told |= {event.href: event for event in changed}
        return write_xhtml(changed) if changed else b""
