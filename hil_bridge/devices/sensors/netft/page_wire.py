"""Datagrams of a Net F/T, and its page. The page is fetched over HTTP in parallel and passed to the client as a
`Page`.
"""

import asyncio
from collections.abc import Callable
from contextlib import suppress

from hil_bridge.clock import Clock
from hil_bridge.errors import BridgeError, TransportError
from hil_bridge.transports import Datagrams, Transport, connect_bytes
from protocol.devices.netft.http import Page, encode_get, read_answer
from protocol.endpoint import RemoteProtocolError

RETRY_S = 0.25
"""Time between two attempts to fetch the page, s. Chosen: the initial value of netft-cpp."""


class WithPage:
    """Transport of datagrams that also fetches the page, from its start until an attempt succeeds."""

    def __init__(self, wire: Transport[Datagrams], page_url: str, timeout_s: float, clock: Clock) -> None:
        """Create a transport. `page_url` is the byte wire of the page's server; `timeout_s` is the time-out for one
        answer, s.
        """
        self.name = wire.name
        self.send = wire.send
        self._wire = wire
        self._url = page_url
        self._timeout = timeout_s
        self._clock = clock
        self._task: asyncio.Task[None] | None = None

    def start(self, on_data: Callable[[Datagrams], None], on_end: Callable[[TransportError], None]) -> None:
        """Start the datagram wire and the fetching of the page."""
        self._wire.start(on_data, on_end)
        self._task = self._clock.loop.create_task(self._fetch(on_data))

    async def aclose(self) -> None:
        """Stop fetching the page and close the datagram wire."""
        if self._task is not None:
            self._task.cancel()
            with suppress(asyncio.CancelledError):
                await self._task
        await self._wire.aclose()

    async def _fetch(self, on_data: Callable[[Datagrams], None]) -> None:
        while True:
            page = await self._page()
            on_data([page])
            if not page.failure:
                return
            await self._clock.sleep_until(self._clock.now() + RETRY_S)

    async def _page(self) -> Page:
        """Return the page, or the reason why this attempt has failed."""
        try:
            wire = await connect_bytes(self._url, self._clock, lambda kind, text: None)
        except BridgeError as error:
            return Page(failure=str(error))
        try:
            async with asyncio.timeout(self._timeout):
                return Page(await self._exchange(wire))
        except TimeoutError:
            return Page(failure=f"{self._url} does not answer within {self._timeout:g} s")
        except (BridgeError, RemoteProtocolError) as error:
            return Page(failure=f"{self._url}: {error}")
        finally:
            await wire.aclose()

    async def _exchange(self, wire: Transport[bytes]) -> bytes:
        body: asyncio.Future[bytes] = self._clock.loop.create_future()
        received = bytearray()

        def parse(ended: bool) -> None:
            if body.done():
                return
            try:
                answer = read_answer(bytes(received), ended)
            except RemoteProtocolError as error:
                body.set_exception(error)
            else:
                if answer is not None:
                    body.set_result(answer)

        def take(data: bytes) -> None:
            received.extend(data)
            parse(ended=False)

        wire.start(take, lambda error: parse(ended=True))
        wire.send(encode_get(self._url.rpartition("//")[2].partition("?")[0]))
        return await body
