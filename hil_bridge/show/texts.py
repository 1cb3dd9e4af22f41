"""Texts for people, as every view shows them."""

import re

_PLACE = re.compile(r" on (?:[a-z][a-z0-9+.-]*:/|memory:)[^\s,;]*")


def without_places(text: str) -> str:
    """A text that does not name on which URL a device is, for where there is room for a few words alone."""
    return _PLACE.sub("", text)
