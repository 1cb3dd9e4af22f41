"""Where a run is shown while it goes on: on the terminal, and on a page in the browser."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

from hil_bridge.errors import ConfigError
from hil_bridge.record.topics import Record
from hil_bridge.runs.run_log import Keeper
from hil_bridge.show.web.feed import Feed, WebOptions


@dataclass(frozen=True, slots=True)
class Views:
    """What a person wants to see."""

    terminal: bool = True
    web: WebOptions | None = None
    """The page; None for none."""


@contextmanager
def fed(views: Views, virtual: bool) -> Iterator[Feed | None]:
    """The feed of the page, if one is wanted. Raises ConfigError."""
    if views.web is None:
        yield None
        return
    if virtual:
        raise ConfigError(
            "--web shows a run that goes on in real time; run without it, then `hil-bridge view` its recording"
        )
    feed = Feed(views.web)
    try:
        yield feed
    finally:
        feed.close()


class Relay:
    """Gives every record to a keeper, then to the page. Only the keeper holds them for long."""

    def __init__(self, keeper: Keeper, feed: Feed) -> None:
        self._keeper, self._feed = keeper, feed

    def put(self, record: Record) -> None:
        """Take a record."""
        self._keeper.put(record)
        self._feed.put(record)

    def devices(self, facts: Mapping[str, str]) -> None:
        """Take the facts of the devices."""
        self._keeper.devices(facts)

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Take an attachment."""
        self._keeper.attach(name, media_type, data)

    def pause(self, seconds: float) -> None:
        """The run awaits nothing for so long, s."""
        self._keeper.pause(seconds)

    def close(self, end: Mapping[str, str]) -> None:
        """Take the end."""
        self._keeper.close(end)
