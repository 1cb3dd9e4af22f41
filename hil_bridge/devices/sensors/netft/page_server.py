"""Server of the pages of an emulated Net F/T over TCP. Each connection has one GET request, as from browsers and
other clients.
"""

import asyncio
from collections.abc import Callable

from hil_bridge.transports import reasons

CLIENT_LIMIT = 8
"""Maximum number of simultaneous connections; any further connection is closed at once. Chosen."""
PATIENCE_S = 5.0
"""Time after which a client without a request is disconnected, s. Chosen."""
_REQUEST_LIMIT = 16384
"""Maximum size of a request, bytes. Chosen."""

Answer = Callable[[bytes], bytes | None]
"""Function that returns the answer to the bytes received so far, or None if more bytes are needed or the box is
booting.
"""


class PageServer:
    """Server that answers requests with the function `answer`."""

    def __init__(self, answer: Answer) -> None:
        self._answer = answer
        self._server: asyncio.Server | None = None
        self._clients: set[asyncio.Task[None]] = set()

    async def listen(self, host: str, port: int) -> int:
        """Start listening and return the actual port. Raises TransportUnavailable if the port cannot be opened."""
        try:
            self._server = await asyncio.start_server(self._serve, host, port)
        except OSError as error:
            name = f"tcp-listen://{host}:{port}"
            raise reasons.unavailable("tcp-listen", name, f"{host}:{port}", error) from error
        number: int = self._server.sockets[0].getsockname()[1]
        return number

    async def aclose(self) -> None:
        """Stop listening, and close all connections."""
        if self._server is not None:
            self._server.close()
        clients = list(self._clients)
        for client in clients:
            client.cancel()
        await asyncio.gather(*clients, return_exceptions=True)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        if task is None or len(self._clients) >= CLIENT_LIMIT:
            writer.transport.abort()
            return
        self._clients.add(task)
        try:
            async with asyncio.timeout(PATIENCE_S):
                await self._exchange(reader, writer)
        except (TimeoutError, ConnectionError):
            pass  # the client has disconnected, or sends no request
        finally:
            self._clients.discard(task)
            writer.close()

    async def _exchange(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        received = b""
        while len(received) <= _REQUEST_LIMIT:
            data = await reader.read(_REQUEST_LIMIT)
            if not data:
                return
            received += data
            if (answer := self._answer(received)) is not None:
                writer.write(answer)
                await writer.drain()
                return
