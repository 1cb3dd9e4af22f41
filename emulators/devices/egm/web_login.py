"""Digest authentication and sessions of Robot Web Services 1.0.

Source: RFC 2617 for the digest; user and password are the maker's defaults, as abb_librws (9ba0837) has them. Assumed:
the realm, the names of the cookies, the limit of sessions and their life.
"""

import hashlib
import hmac
import re
from collections import OrderedDict
from collections.abc import Mapping

from protocol.devices.egm.web import PASSWORD, USER

REALM = "validusers@robapi.abb"
SESSION_COOKIE, SECOND_COOKIE = "-http-session-", "ABBCX"
SESSIONS_MAX = 70
SESSION_S = 300.0
NONCES_MAX = 256
"""Chosen: nonces that are kept, so that no client makes the list grow."""
_FIELD = re.compile(r'(\w+)\s*=\s*(?:"([^"]*)"|([^\s,]+))')
_HEADER_MAX = 2048


class Login:
    """Decides which requests are answered. It knows no clock: `now` comes with each question."""

    def __init__(self, secret: bytes) -> None:
        """`secret` makes nonces and session numbers."""
        self._secret = secret
        self._made = 0
        self._nonces: OrderedDict[str, None] = OrderedDict()
        self._sessions: dict[str, float] = {}
        """When each session was used last, s."""

    @property
    def sessions(self) -> int:
        """Number of sessions that are kept."""
        return len(self._sessions)

    def challenge(self) -> str:
        """Value of `WWW-Authenticate` for a client without credentials."""
        nonce = self._draw()
        self._nonces[nonce] = None
        if len(self._nonces) > NONCES_MAX:
            self._nonces.popitem(last=False)
        return f'Digest realm="{REALM}", domain="/", qop="auth", nonce="{nonce}", algorithm="MD5"'

    def knows(self, cookies: Mapping[str, str], now: float) -> bool:
        """Whether these cookies are of a session that lives; it lives on then."""
        session = cookies.get(SESSION_COOKIE, "")
        self._expire(now)
        if session not in self._sessions:
            return False
        self._sessions[session] = now
        return True

    def accepts(self, header: str, method: str, target: str) -> bool:
        """Whether the value of `Authorization` is right for this request."""
        if len(header) > _HEADER_MAX or not header.lower().startswith("digest "):
            return False
        fields = {name.lower(): quoted or plain for name, quoted, plain in _FIELD.findall(header)}
        nonce, uri = fields.get("nonce", ""), fields.get("uri", "")
        if nonce not in self._nonces or uri != target or fields.get("username") != USER:
            return False
        owner, request = _md5(f"{USER}:{REALM}:{PASSWORD}"), _md5(f"{method}:{uri}")
        if fields.get("qop") == "auth":
            middle = f"{nonce}:{fields.get('nc', '')}:{fields.get('cnonce', '')}:auth"
        else:
            middle = nonce
        expected = _md5(f"{owner}:{middle}:{request}")
        return hmac.compare_digest(expected.encode(), fields.get("response", "").lower().encode())

    def open(self, now: float) -> Mapping[str, str] | None:
        """Cookies of a new session; None where there are as many as may be."""
        self._expire(now)
        if len(self._sessions) >= SESSIONS_MAX:
            return None
        session = self._draw()
        self._sessions[session] = now
        return {SESSION_COOKIE: session, SECOND_COOKIE: str(self._made)}

    def close(self, cookies: Mapping[str, str]) -> None:
        """Forget a session."""
        self._sessions.pop(cookies.get(SESSION_COOKIE, ""), None)

    def _expire(self, now: float) -> None:
        for session in [name for name, used in self._sessions.items() if now - used > SESSION_S]:
            del self._sessions[session]

    def _draw(self) -> str:
        self._made += 1
        return hmac.new(self._secret, str(self._made).encode(), hashlib.sha256).hexdigest()[:32]


def _md5(text: str) -> str:
    return hashlib.md5(text.encode(), usedforsecurity=False).hexdigest()
