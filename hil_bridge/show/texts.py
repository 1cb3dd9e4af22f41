"""Texts for people, as every view shows them."""

import re

_PLACE = re.compile(r" on (?:[a-z][a-z0-9+.-]*:/|memory:)[^\s,;]*")
_QUERY = re.compile(r"(\b[a-z][a-z0-9+.-]*:/{0,2}[^\s?]*)\?[^\s,;:]+")


def without_places(text: str) -> str:
    """A text that does not name on which URL a device is, for where there is room for a few words alone."""
    return _PLACE.sub("", text)


def without_queries(text: str) -> str:
    """A text whose URLs are cut before their `?`: what follows drowns the rest, and the recording keeps it."""
    return _QUERY.sub(r"\1", text)
