"""Admission of requests to the page's server by Host, Origin, token and rate. This module reads no clock."""

import hmac
import ipaddress
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from urllib.parse import urlsplit

TOKEN_HEADER = "X-Hil-Bridge-Token"
"""Name of the custom header that holds the token. A browser sends a preflight request before it sends this header
across origins, and the server refuses the preflight.
"""
CSP = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS: Mapping[str, str] = {
    "Content-Security-Policy": CSP,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
}
"""Headers of every response."""


def host_name(host: str) -> str:
    """Return the name or address in a Host header, without port and brackets; empty if it is invalid."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


def is_loopback(host: str) -> bool:
    """Return whether a Host header names the loopback address of this machine.

    The check refuses a page under another name whose address was later changed to loopback (DNS rebinding).
    """
    name = host_name(host)
    if name == "localhost":
        return True
    try:
        return ipaddress.ip_address(name).is_loopback
    except ValueError:
        return False


@dataclass(frozen=True, slots=True)
class Admission:
    """Admission rules of a run's server."""

    token: str
    """Token that is required to end the run."""
    origins: Collection[str] = ()
    """Additional origins that may read the page."""

    def refusal(self, host: str, origin: str | None, site: str = "") -> str:
        """Return the reason why a request is refused; empty if it is admitted.

        `site` is the browser's Sec-Fetch-Site header. A browser also sends it, without an Origin, when a page
        embeds a resource such as an image. A program other than a browser sends no Origin.
        """
        if not is_loopback(host):
            return f"this server is not {host[:80] or 'nameless'}: open it as 127.0.0.1 or localhost"
        if origin is None:
            return "" if site != "cross-site" else "pages of another origin may not load parts of this one"
        if origin in (f"http://{host}", *self.origins):
            return ""
        return f"pages of {origin[:80]} may not read this run; --web-origin names one that may"

    def may_end(self, token: str) -> bool:
        """Return whether this is the token of the run. The comparison takes constant time."""
        return bool(self.token) and hmac.compare_digest(token.encode(errors="replace"), self.token.encode())


class Bucket:
    """Token bucket with a rate per second and a burst size."""

    def __init__(self, per_s: float, burst: float, clock: Callable[[], float]) -> None:
        self._per_s, self._burst, self._clock = per_s, burst, clock
        self._left, self._at = burst, clock()

    def take(self) -> bool:
        """Return whether one more request is allowed now, and count it."""
        now = self._clock()
        self._left = min(self._burst, self._left + (now - self._at) * self._per_s)
        self._at = now
        if self._left < 1:
            return False
        self._left -= 1
        return True
