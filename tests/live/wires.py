"""Pseudo-terminal with a program at each end, and waiting for bytes, for tests of wires in real time."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from hil_bridge.clock import Clock
from hil_bridge.testing.transports import Ear, StreamCase
from hil_bridge.transports import connect_bytes, listen_bytes


async def wait_for_bytes(ear: Ear, count: int) -> None:
    await ear.until(lambda: len(ear.data) == count)


@asynccontextmanager
async def pty_wire(clock: Clock) -> AsyncIterator[Any]:
    listening = await listen_bytes("pty:", clock)
    yield await connect_bytes(f"{listening.address}?baudrate=9600&parity=E", clock), listening.transport


BYTES = StreamCase("bytes", pty_wire)
