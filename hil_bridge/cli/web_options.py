"""Options of commands that serve a page."""

from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import click

if TYPE_CHECKING:
    from hil_bridge.show.web.feed import WebOptions


def web_options(enabled: bool, port: int | None, origins: tuple[str, ...]) -> "WebOptions | None":
    """Return the options of a run's page, or None if the page is not enabled. Raises click.UsageError if they are
    invalid.
    """
    from hil_bridge.show.web.feed import WebOptions

    if not enabled:
        if port is not None or origins:
            raise click.UsageError("--web-port and --web-origin need --web", click.get_current_context())
        return None
    return WebOptions(port or 0, tuple(map(_origin, origins)))


def _origin(text: str) -> str:
    """Return an origin in the form that a browser sends: scheme, host and, if necessary, port."""
    parts = urlsplit(text)
    if not (parts.scheme and parts.netloc) or parts.path not in ("", "/") or parts.query or parts.fragment:
        raise click.BadParameter(f"must be an origin such as https://app.foxglove.dev, got {text!r}")
    return f"{parts.scheme}://{parts.netloc}".lower()
