"""Digest authentication and sessions of Robot Web Services 1.0.

Source: RFC 2617 for the digest; user and password are the maker's defaults, as in abb_librws (9ba0837). Assumed:
the realm, the names of the cookies, the maximum number of sessions and their lifetime.
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
"""Maximum number of stored nonces. Chosen, so that no client can exhaust the memory."""
_FIELD = re.compile(r'(\w+)\s*=\s*(?:"([^"]*)"|([^\s,]+))')
_HEADER_MAX = 2048


class Login:
    """Decides which requests are authorised. The caller passes the time as `now`."""

    def __init__(self, secret: bytes) -> None:
        """Use `secret` to create nonces and session numbers."""
        self._secret = secret
        self._nonces_made = 0
        self._nonces: OrderedDict[str, None] = OrderedDict()
        self._sessions: dict[str, float] = {}
        """Time of the last use of each session, s."""

    @property
    def sessions(self) -> int:
        """Number of stored sessions."""
        return len(self._sessions)

    def challenge(self) -> str:
        """Return the value of `WWW-Authenticate` for a client without credentials."""
        nonce = self._draw()
        self._nonces[nonce] = None
        if len(self._nonces) > NONCES_MAX:
            self._nonces.popitem(last=False)
        return f'Digest realm="{REALM}", domain="/", qop="auth", nonce="{nonce}", algorithm="MD5"'

    def knows(self, cookies: Mapping[str, str], now: float) -> bool:
        """Return whether these cookies belong to an active session, and extend its lifetime."""
        session = cookies.get(SESSION_COOKIE, "")
        self._expire(now)
        if session not in self._sessions:
            return False
        self._sessions[session] = now
        return True

    def accepts(self, header: str, method: str, target: str) -> bool:
        """Return whether the value of `Authorization` is valid for this request."""
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
        """Return the cookies of a new session; None if there are too many."""
        self._expire(now)
        if len(self._sessions) >= SESSIONS_MAX:
            return None
        session = self._draw()
        self._sessions[session] = now
        return {SESSION_COOKIE: session, SECOND_COOKIE: str(self._nonces_made)}

    def close(self, cookies: Mapping[str, str]) -> None:
        """End a session."""
        self._sessions.pop(cookies.get(SESSION_COOKIE, ""), None)

    def _expire(self, now: float) -> None:
        for session in [name for name, used in self._sessions.items() if now - used > SESSION_S]:
            del self._sessions[session]

    def _draw(self) -> str:
        self._nonces_made += 1
        return hmac.new(self._secret, str(self._nonces_made).encode(), hashlib.sha256).hexdigest()[:32]


def _md5(text: str) -> str:
    return hashlib.md5(text.encode(), usedforsecurity=False).hexdigest()
