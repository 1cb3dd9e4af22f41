"""Subscriptions of Robot Web Services 1.0: changes since the last report to a subscriber.

Changes are not queued. A value that changed twice between two reports is reported once, with its newest value.
"""

from collections.abc import Callable, Sequence

from emulators.devices.egm.web_documents import Item, write_xhtml

GROUPS_MAX = 64
"""Maximum number of simultaneous subscriptions. Chosen."""
RESOURCES_MAX = 64
"""Maximum number of resources in one subscription; further ones are ignored. Chosen."""


class Subscriptions:
    """Subscriptions of a controller, by number."""

    def __init__(self, find_event: Callable[[str], Item]) -> None:
        """Start without subscriptions. `find_event` returns the event with a resource's current value."""
        self._find_event = find_event
        self._groups: dict[str, dict[str, Item]] = {}
        """Newest event of each resource, by subscription number."""
        self._begun = 0

    def begin(self, resources: Sequence[str]) -> str | None:
        """Begin a subscription at the current values. Return its number, or None if there are too many
        subscriptions.
        """
        if len(self._groups) >= GROUPS_MAX:
            return None
        self._begun += 1
        self._groups[f"{self._begun}"] = {one: self._find_event(one) for one in resources[:RESOURCES_MAX]}
        return f"{self._begun}"

    def end(self, number: str) -> bool:
        """End a subscription; return whether it existed."""
        return self._groups.pop(number, None) is not None

    def knows(self, number: str) -> bool:
        """Return whether a subscription exists."""
        return number in self._groups

    def news(self, number: str) -> bytes:
        """Return the document of changes since the last report; empty if nothing has changed."""
        reported = self._groups.get(number, {})
        changed = [event for one in reported if (event := self._find_event(one)) != reported[one]]
        reported |= {event.href: event for event in changed}
        return write_xhtml(changed) if changed else b""
