"""Live page of a running campaign: the body of the saved page, rendered again whenever the results change."""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hil_bridge.errors import ConfigError
from hil_bridge.lab.campaign.page import PageBody, page_title
from hil_bridge.lab.campaign.store import Store

POLL_S = 0.5
"""Shortest time between two checks of the results file, s. Chosen."""
REST_FACTOR = 5.0
"""Shortest pause after a rendering, as a multiple of the time that it took. Chosen: leaves most of the computer to
the runs.
"""


@dataclass(slots=True)
class PageState:
    """State of one page in a browser: the version of the results that it displays."""

    version: int = -1


class Results:
    """Source of the live page of campaign results, which another process may be writing."""

    over = False
    """Whether the source has ended: always False, because the file exists until the server ends."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._body = PageBody()
        self._content: dict[str, str] = {}
        self._version = 0
        self._file_version: int | None = None
        self._next_check = 0.0

    def first(self) -> PageState:
        """Return the state of a page that does not display anything yet."""
        return PageState()

    def handle_request(self, state: Any, message: Mapping[str, Any]) -> None:
        """Reject every message, because a page of results sends none."""
        raise ValueError("a page of results accepts no messages")

    def updates(self, state: Any) -> Mapping[str, Any] | None:
        """Return the complete page if it has changed since the last update."""
        if time.monotonic() >= self._next_check:
            self._check()
        if state.version == self._version:
            return None
        state.version = self._version
        return self._content

    def _check(self) -> None:
        began = time.monotonic()
        try:
            content = self._render()
        except ConfigError as error:
            content = {**self._content, "trouble": str(error)}
        if content != self._content:
            self._content = content
            self._version += 1
        now = time.monotonic()
        self._next_check = now + max(POLL_S, REST_FACTOR * (now - began))

    def _render(self) -> dict[str, str]:
        """Render title, file and body; return the previous content if the file has not changed."""
        version = self._store.version()
        if version == self._file_version:
            return self._content
        body, title = self._body.render(self._store), page_title(self._store.plan())
        self._file_version = version
        return {"title": title, "file": str(self._store.path), "body": body, "trouble": ""}
