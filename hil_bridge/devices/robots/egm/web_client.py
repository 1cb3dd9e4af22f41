"""A look at a real or emulated controller over its web services. It reads four documents and changes nothing."""

import asyncio
import json
from typing import Any, NamedTuple

import aiohttp

from hil_bridge.devices.robots.egm.web_address import WebAddress
from hil_bridge.errors import DeviceError
from protocol.devices.egm.web import PASSWORD, USER
from protocol.endpoint import Trouble

PATIENCE_S = 3.0
"""Chosen: longest wait for all four."""
DOCUMENT_MAX = 1 << 18
"""Chosen: most bytes of a document; more is no answer."""
_OTHER = "is it a controller with RobotWare 6?"
_VALUES = {
    "rwversion": "/rw/system?json=1",
    "ctrlstate": "/rw/panel/ctrlstate?json=1",
    "opmode": "/rw/panel/opmode?json=1",
    "ctrlexecstate": "/rw/rapid/execution?json=1",
}
"""Documents that are read, by the value that is looked for."""


class WebState(NamedTuple):
    """Facts that a controller tells of itself."""

    version: str
    motors: str
    """motoron, motoroff, emergencystop, guardstop and others."""
    mode: str
    """AUTO, MANR or MANF."""
    execution: str
    """running or stopped."""


_REFUSALS = (
    ("motors", "motoron", "the motors are off", "switch them on"),
    ("execution", "running", "the RAPID program is stopped", "start it"),
)
"""Field of a state, the value that a run needs, and the trouble of any other one."""


def state_rows(state: WebState) -> tuple[tuple[str, str], ...]:
    """A state for people."""
    return (
        ("RobotWare", state.version),
        ("motors", state.motors),
        ("mode", state.mode),
        ("RAPID", state.execution),
    )


def find_refusals(state: WebState) -> tuple[Trouble, ...]:
    """Reasons for which a run would not begin in this state."""
    return tuple(
        Trouble(f"{fact} ({getattr(state, field)})", remedy)
        for field, needed, fact, remedy in _REFUSALS
        if getattr(state, field) != needed
    )


async def read_state(address: WebAddress) -> WebState:
    """Ask a controller, with the maker's usual user and password. Raises DeviceError within `PATIENCE_S`."""
    name = f"web services at {address.authority}"
    texts: list[str] = []
    digest = aiohttp.DigestAuthMiddleware(USER, PASSWORD)
    try:
        async with (
            asyncio.timeout(PATIENCE_S),
            aiohttp.ClientSession(f"http://{address.authority}", middlewares=(digest,)) as session,
        ):
            for key, path in _VALUES.items():
                texts.append(await _read(session, key, path, name))
    except TimeoutError:
        raise DeviceError(
            f"{name} do not answer within {PATIENCE_S:g} s", remedy="look at the address and the cable"
        ) from None
    except (aiohttp.ClientError, OSError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise DeviceError(
            f"{name}: {reason}", remedy="look at the address, the port and the cable"
        ) from error
    return WebState(*texts)


async def _read(session: aiohttp.ClientSession, key: str, path: str, name: str) -> str:
    async with session.get(path, allow_redirects=False) as response:
        if response.status == 401:
            raise DeviceError(
                f"{name} refuse the usual user and password", remedy="let its administrator allow them"
            )
        if response.status != 200:
            raise DeviceError(f"{name} answer {path} with {response.status}", remedy=_OTHER)
        body = b""
        async for piece in response.content.iter_chunked(65_536):
            body += piece
            if len(body) > DOCUMENT_MAX:
                raise DeviceError(f"{name} send too long a document for {path}", remedy="look at the address")
    text = _find(body, key)
    if text is None:
        raise DeviceError(f"{name} tell no {key}", remedy=_OTHER)
    return text


def _find(body: bytes, key: str) -> str | None:
    """The text of a key in the state that a document embeds; None where there is none."""
    try:
        document: Any = json.loads(body)
    except (ValueError, RecursionError):
        return None
    embedded = document.get("_embedded") if isinstance(document, dict) else None
    items = embedded.get("_state") if isinstance(embedded, dict) else None
    for item in items if isinstance(items, list) else ():
        text = item.get(key) if isinstance(item, dict) else None
        if isinstance(text, str) and text.isprintable() and len(text) < 200:
            return text
    return None
