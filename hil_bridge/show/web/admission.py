"""Which requests the page's server takes: by Host, Origin, token, and how many. It reads no clock by itself."""

import hmac
import ipaddress
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from urllib.parse import urlsplit

TOKEN_HEADER = "X-Hil-Bridge-Token"
"""A header of our own: a browser asks first whether another origin may send it, and is refused."""
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
"""Headers of every answer."""


def host_name(host: str) -> str:
    """Name or address in a Host header, without port and brackets; empty for one that is none."""
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
    """The requests that the server of a run takes."""

    token: str
    """Needed to end the run."""
    origins: Collection[str] = ()
    """Origins of other pages that may read."""

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
        """Whether this is the run's token; its comparison takes the same time for every wrong one."""
        return bool(self.token) and hmac.compare_digest(token.encode(errors="replace"), self.token.encode())


class Bucket:
    """Allows so many things a second, and a burst."""

    def __init__(self, per_s: float, burst: float, clock: Callable[[], float]) -> None:
        self._per_s, self._burst, self._clock = per_s, burst, clock
        self._left, self._at = burst, clock()

    def take(self) -> bool:
        """Whether one more is allowed now."""
        now = self._clock()
        self._left = min(self._burst, self._left + (now - self._at) * self._per_s)
        self._at = now
        if self._left < 1:
            return False
        self._left -= 1
        return True
