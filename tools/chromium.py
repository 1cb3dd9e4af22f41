# ruff: noqa: ASYNC220, ASYNC240
"""Headless Chromium, controlled by the DevTools protocol. It uses the system's installation; nothing is downloaded."""

import asyncio
import base64
import itertools
import json
import os
import shutil
import signal
import subprocess
import tempfile
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any

from aiohttp import ClientSession, ClientWebSocketResponse

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
PATIENCE_S = 40.0


def found() -> str | None:
    """Return the path of an installed Chromium, or None."""
    return next(filter(None, map(shutil.which, NAMES)), None)


class Page:
    """Page of the browser."""

    def __init__(self, socket: ClientWebSocketResponse) -> None:
        self._socket = socket
        self._numbers = itertools.count(1)
        self.errors: list[str] = []
        """Errors on the page's console, and messages about blocked scripts and styles."""

    async def call(self, method: str, **parameters: object) -> Any:
        """Send a command of the DevTools protocol."""
        number = next(self._numbers)
        await self._socket.send_json({"id": number, "method": method, "params": parameters})
        async with asyncio.timeout(PATIENCE_S):
            while True:
                response = await self._socket.receive_json()
                if response.get("id") == number:
                    assert "error" not in response, response
                    return response["result"]
                self._event(response)

    def _event(self, response: Any) -> None:
        what, facts = response.get("method"), response.get("params", {})
        if what == "Runtime.exceptionThrown":
            self.errors.append(json.dumps(facts["exceptionDetails"])[:600])
        if what == "Log.entryAdded" and facts["entry"]["level"] == "error":
            self.errors.append(facts["entry"]["text"])

    async def open(self, url: str, width: int = 1440, height: int = 1000, phone: bool = False) -> None:
        """Open an address at this window size."""
        for domain in ("Runtime", "Log", "Page"):
            await self.call(f"{domain}.enable")
        await self.size(width, height, phone)
        await self.call("Page.navigate", url=url)

    async def size(self, width: int, height: int, phone: bool = False) -> None:
        """Set the size of the page."""
        await self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=2 if phone else 1,
            mobile=phone,
        )

    async def scheme(self, name: str) -> None:
        """Emulate the preferred colour scheme, `dark` or `light`."""
        feature = [{"name": "prefers-color-scheme", "value": name}]
        await self.call("Emulation.setEmulatedMedia", features=feature)

    async def value(self, script: str) -> Any:
        """Return the value of an expression in the page. A promise is awaited."""
        response = await self.call(
            "Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in response, response
        return response["result"].get("value")

    async def until(self, script: str, patience_s: float = PATIENCE_S) -> Any:
        """Wait until an expression is true, and return its value."""
        try:
            async with asyncio.timeout(patience_s):
                while True:
                    if (value := await self.value(script)) not in (None, False, 0, ""):
                        return value
                    await asyncio.sleep(0.05)
        except TimeoutError:
            text = await self.value("document.body ? document.body.innerText.slice(0, 1500) : ''")
            raise AssertionError(f"never true: {script}\n{text}\n{self.errors}") from None

    async def press(self, key: str, shift: bool = False) -> None:
        """Press and release a key, as a keyboard does. The element with the focus receives it."""
        for kind in ("keyDown", "keyUp"):
            await self.call("Input.dispatchKeyEvent", type=kind, key=key, modifiers=8 * shift)

    async def metrics(self) -> dict[str, float]:
        """Return the browser's metrics of the page after garbage collection, with processor time for durations."""
        await self.call("Performance.enable", timeDomain="threadTicks")
        await self.call("HeapProfiler.collectGarbage")
        return {one["name"]: one["value"] for one in (await self.call("Performance.getMetrics"))["metrics"]}

    async def screenshot(self, path: Path, whole: bool = False) -> None:
        """Save the page as a PNG."""
        response = await self.call("Page.captureScreenshot", format="png", captureBeyondViewport=whole)
        path.write_bytes(base64.b64decode(response["data"]))


@asynccontextmanager
async def browser() -> AsyncIterator[Page]:
    """Open a page in a new browser with an empty profile. The profile is deleted afterwards. Raises
    FileNotFoundError.
    """
    if (path := found()) is None:
        raise FileNotFoundError("there is no Chromium on this machine")
    with tempfile.TemporaryDirectory(prefix="chromium-", ignore_cleanup_errors=True) as folder:
        process = subprocess.Popen(
            [
                path,
                "--headless=new",
                "--remote-debugging-port=0",
                f"--user-data-dir={folder}",
                "--no-sandbox",  # the tests may run as root in a container
                "--disable-gpu",
                "--disable-dev-shm-usage",
                "--no-first-run",
                "--no-default-browser-check",
                "--disable-background-networking",
                "--disable-quic",
                "--disable-component-update",
                "--disable-sync",
                "--hide-scrollbars",
                "about:blank",
            ],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        try:
            async with ClientSession() as session:
                port = await _port(Path(folder) / "DevToolsActivePort")
                async with session.get(f"http://127.0.0.1:{port}/json/list") as answer:
                    pages = [page for page in await answer.json() if page["type"] == "page"]
                address = pages[0]["webSocketDebuggerUrl"]
                async with session.ws_connect(address, max_msg_size=0) as socket:
                    yield Page(socket)
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


async def _port(file: Path) -> str:
    async with asyncio.timeout(PATIENCE_S):
        while True:
            if file.is_file() and (lines := file.read_text().split()):
                return lines[0]
            await asyncio.sleep(0.05)
