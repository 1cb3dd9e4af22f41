"""Admission of requests to the page's server: Host, Origin, token and rate. It reads no clock."""

import hmac
import ipaddress
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from urllib.parse import urlsplit

TOKEN_HEADER = "X-Hil-Bridge-Token"
"""Custom header: for another origin, a browser sends a preflight request first, which is refused."""
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
    """Whether a Host header names this machine's loopback. So a page of another name, whose address was turned to
    loopback later, is refused.
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
    """Other origins that may read."""

    def refusal(self, host: str, origin: str | None, site: str = "") -> str:
        """Why a request is refused, or nothing. A program that is no browser sends no Origin. `site` is where a browser
        says that a part of a page is wanted from, as a picture, for which it sends no Origin either.
        """
        if not is_loopback(host):
            return f"this server is not {host[:80] or 'nameless'}: open it as 127.0.0.1 or localhost"
        if origin is None:
            return "" if site != "cross-site" else "pages of another origin may not load parts of this one"
        if origin in (f"http://{host}", *self.origins):
            return ""
        return f"pages of {origin[:80]} may not read this run; --web-origin names one that may"

    def may_end(self, token: str) -> bool:
        """Return whether this is the run's token, compared in constant time."""
        return bool(self.token) and hmac.compare_digest(token.encode(errors="replace"), self.token.encode())


class Bucket:
    """Token bucket: a rate per second, and a burst."""

    def __init__(self, per_s: float, burst: float, clock: Callable[[], float]) -> None:
        self._per_s, self._burst, self._clock = per_s, burst, clock
        self._left, self._at = burst, clock()

    def take(self) -> bool:
        """Return whether one more is allowed now, and count it."""
        now = self._clock()
        self._left = min(self._burst, self._left + (now - self._at) * self._per_s)
        self._at = now
        if self._left < 1:
            return False
        self._left -= 1
        return True
