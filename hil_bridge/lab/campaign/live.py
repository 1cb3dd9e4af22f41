"""The page of a campaign that goes on: the body of the saved page, rendered anew when the results have changed."""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hil_bridge.errors import ConfigError
from hil_bridge.lab.campaign.page import PageBody, page_title
from hil_bridge.lab.campaign.store import Store

LOOK_S = 0.5
"""Least time between two looks at the file. Chosen."""
REST = 5.0
"""Least rest after a rendering, in times that it took: a large campaign leaves the computer to its runs. Chosen."""


@dataclass(slots=True)
class Seen:
    """The state of one page: the version that it shows."""

    version: int = -1


class Results:
    """Tells pages of a campaign's results, which another process may be writing."""

    over = False
    """The file is there until the server is ended."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._body = PageBody()
        self._told: dict[str, str] = {}
        self._version = 0
        self._file_version: int | None = None
        self._next_look = 0.0

    def first(self) -> Seen:
        """A page that knows nothing."""
        return Seen()

    def asked(self, state: Any, message: Mapping[str, Any]) -> None:
        """A page of results asks for nothing."""
        raise ValueError("a page of results asks for nothing")

    def news(self, state: Any) -> Mapping[str, Any] | None:
        """The whole page, when it has changed."""
        if time.monotonic() >= self._next_look:
            self._look()
        if state.version == self._version:
            return None
        state.version = self._version
        return self._told

    def _look(self) -> None:
        began = time.monotonic()
        try:
            told = self._render()
        except ConfigError as error:
            told = {**self._told, "trouble": str(error)}
        if told != self._told:
            self._told = told
            self._version += 1
        now = time.monotonic()
        self._next_look = now + max(LOOK_S, REST * (now - began))

    def _render(self) -> dict[str, str]:
        """Title, file and body; what is told already where the file has not changed."""
        version = self._store.version()
        if version == self._file_version:
            return self._told
        body, title = self._body.render(self._store), page_title(self._store.plan())
        self._file_version = version
        return {"title": title, "file": str(self._store.path), "body": body, "trouble": ""}
