"""Echo server on plain asyncio, as a bridge that does no work.

asyncio_echo.py tcp|udp PACKET ANSWER, like `relay echo` of `c/relay.c`: it answers each packet of PACKET bytes with
the first ANSWER bytes of the packet. The first line of its output is the port.
"""

import asyncio
import sys
from typing import Any


class Echo(asyncio.Protocol, asyncio.DatagramProtocol):
    """Answers packets of one client over TCP or UDP."""

    def __init__(self, packet: int, answer: int, ended: asyncio.Event) -> None:
        self._packet, self._answer, self._ended = packet, answer, ended
        self._wire: Any = None
        self._rest = b""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._wire = transport

    def datagram_received(self, data: bytes, addr: Any) -> None:
        self._wire.sendto(data[: self._answer], addr)

    def data_received(self, data: bytes) -> None:
        self._rest += data
        while len(self._rest) >= self._packet:
            self._wire.write(self._rest[: self._answer])
            self._rest = self._rest[self._packet :]

    def connection_lost(self, exc: Exception | None) -> None:
        self._ended.set()


async def main(kind: str, packet: int, answer: int) -> None:
    """Answer until the client disconnects, or without end over UDP."""
    loop, ended = asyncio.get_running_loop(), asyncio.Event()
    if kind == "tcp":
        server = await loop.create_server(lambda: Echo(packet, answer, ended), "127.0.0.1", 0)
        address = server.sockets[0].getsockname()
    else:
        wire, _ = await loop.create_datagram_endpoint(
            lambda: Echo(packet, answer, ended), local_addr=("127.0.0.1", 0)
        )
        address = wire.get_extra_info("sockname")
    print(address[1], flush=True)
    await ended.wait()


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1], *map(int, sys.argv[2:])))
