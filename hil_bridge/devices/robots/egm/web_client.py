"""Client of the web services of a real or emulated controller. It reads four documents and changes nothing.

The documents have the format of RobotWare 6: RWS 1.0, HTTP with digest authentication, `?json=1` for JSON,
otherwise XHTML. RobotWare 7 has RWS 2.0: HTTPS with basic authentication, and the version 2 in its content types.
RWS 2.0 is recognized but not read. Source: ABB's page on Robot Web Services (3HAC050973-001) for JSON and XHTML,
and public clients of RWS 2.0.
"""

import asyncio
import json
import ssl
from contextlib import suppress
from typing import Any, NamedTuple, TypeGuard
from xml.etree import ElementTree

import aiohttp

from hil_bridge.devices.robots.egm.web_address import WebAddress
from hil_bridge.errors import DeviceError
from protocol.devices.egm.web import PASSWORD, USER
from protocol.endpoint import Trouble

PATIENCE_S = 3.0
"""Time-out for reading all four documents, s. Chosen."""
TLS_S = 1.0
"""Time-out for the TLS handshake with a port that may require HTTPS, s. Chosen."""
DOCUMENT_MAX = 1 << 18
"""Maximum size of a document, bytes; a larger document is invalid. Chosen."""
_OTHER = "is it a controller with RobotWare 6?"
_VALUES = {
    "rwversion": "/rw/system?json=1",
    "ctrlstate": "/rw/panel/ctrlstate?json=1",
    "opmode": "/rw/panel/opmode?json=1",
    "ctrlexecstate": "/rw/rapid/execution?json=1",
}
"""Documents to read, by the value that each contains."""


class WebState(NamedTuple):
    """State of a controller, as reported by its web services."""

    version: str
    motors: str
    """State of the motors: motoron, motoroff, emergencystop, guardstop and others."""
    mode: str
    """Operating mode: AUTO, MANR or MANF."""
    execution: str
    """State of the program: running or stopped."""


_REFUSALS = (
    ("motors", "motoron", "the motors are off", "switch the motors on"),
    ("execution", "running", "the RAPID program is stopped", "start the program"),
)
"""Field of a state, the value that a run requires, and the problem and remedy for any other value."""


def state_rows(state: WebState) -> tuple[tuple[str, str], ...]:
    """Return a state as rows for display."""
    return (
        ("RobotWare", state.version),
        ("motors", state.motors),
        ("mode", state.mode),
        ("RAPID", state.execution),
    )


def find_refusals(state: WebState) -> tuple[Trouble, ...]:
    """Return the reasons why a run would not start in this state."""
    return tuple(
        Trouble(f"{fact} ({getattr(state, field)})", remedy)
        for field, needed, fact, remedy in _REFUSALS
        if getattr(state, field) != needed
    )


async def read_state(address: WebAddress) -> WebState:
    """Read a controller's state with the manufacturer's default user and password, then log out. Raises DeviceError
    within `PATIENCE_S` and `TLS_S` if the state cannot be read.
    """
    name = f"web services at {address.authority}"
    texts: list[str] = []
    digest = aiohttp.DigestAuthMiddleware(USER, PASSWORD)
    cookies = aiohttp.CookieJar(unsafe=True)  # a controller has an address but no host name
    try:
        async with (
            asyncio.timeout(PATIENCE_S),
            aiohttp.ClientSession(
                f"http://{address.authority}", middlewares=(digest,), cookie_jar=cookies
            ) as session,
        ):
            for key, path in _VALUES.items():
                texts.append(await _read(session, key, path, name))
            with suppress(aiohttp.ClientError):
                await session.get("/logout")
    except TimeoutError:
        raise DeviceError(
            f"{name} do not answer within {PATIENCE_S:g} s", remedy="check the address and the cable"
        ) from None
    except (aiohttp.ClientError, OSError) as error:
        if not isinstance(error, aiohttp.ClientConnectorError) and await _wants_tls(address):
            raise _newer(name) from None
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise DeviceError(f"{name}: {reason}", remedy="check the address, the port and the cable") from error
    return WebState(*texts)


def _newer(name: str) -> DeviceError:
    return DeviceError(
        f"{name} are those of RobotWare 7 (RWS 2.0); only RobotWare 6 is supported",
        remedy="remove rws from the URL; the datagrams are the same",
    )


async def _wants_tls(address: WebAddress) -> bool:
    """Return whether a port that did not answer HTTP uses TLS."""
    context = ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE  # nothing is sent over this connection
    try:
        async with asyncio.timeout(TLS_S):
            _, writer = await asyncio.open_connection(address.host, address.port, ssl=context)
    except ssl.SSLError as error:
        return "ALERT" in (error.reason or "")  # the port uses another version of TLS
    except (OSError, TimeoutError):
        return False
    writer.transport.abort()
    return True


async def _read(session: aiohttp.ClientSession, key: str, path: str, name: str) -> str:
    async with session.get(path, allow_redirects=False) as response:
        if _is_newer(response):
            raise _newer(name)
        if response.status == 401:
            raise DeviceError(
                f"{name} reject the default user and password", remedy="have its administrator enable them"
            )
        if response.status != 200:
            raise DeviceError(f"{name} answer {path} with {response.status}", remedy=_OTHER)
        body = b""
        async for piece in response.content.iter_chunked(65_536):
            body += piece
            if len(body) > DOCUMENT_MAX:
                raise DeviceError(f"{name} send too long a document for {path}", remedy="check the address")
    text = _find_in_json(body, key) or _find_in_xhtml(body, key)
    if text is None:
        raise DeviceError(f"{name} report no {key}", remedy=_OTHER)
    return text


def _is_newer(response: aiohttp.ClientResponse) -> bool:
    """Return whether a response indicates RWS 2.0."""
    schemes = [
        text.split()[0].lower() for text in response.headers.getall("WWW-Authenticate", ()) if text.strip()
    ]
    basic = response.status == 401 and "basic" in schemes and "digest" not in schemes
    redirected = 300 <= response.status < 400 and response.headers.get("Location", "").startswith("https:")
    return basic or redirected or ";v=2." in response.headers.get("Content-Type", "").replace(" ", "")


def _find_in_json(body: bytes, key: str) -> str | None:
    """Return the text of a key in the state that a document embeds, or None if the key is missing."""
    try:
        document: Any = json.loads(body)
    except (ValueError, RecursionError):
        return None
    embedded = document.get("_embedded") if isinstance(document, dict) else None
    items = embedded.get("_state") if isinstance(embedded, dict) else None
    for item in items if isinstance(items, list) else ():
        text = item.get(key) if isinstance(item, dict) else None
        if _is_plain(text):
            return text
    return None


def _find_in_xhtml(body: bytes, key: str) -> str | None:
    """Return the text of the element with this class, or None if there is no such element. A document with a
    document type is rejected before it is parsed.
    """
    if b"<!" in body:
        return None
    try:
        root = ElementTree.fromstring(body)
    except (ElementTree.ParseError, ValueError, LookupError):
        return None
    texts = (element.text for element in root.iter() if element.get("class") == key)
    return next((text for text in texts if _is_plain(text)), None)


def _is_plain(text: Any) -> TypeGuard[str]:
    return isinstance(text, str) and text.isprintable() and 0 < len(text) < 200
