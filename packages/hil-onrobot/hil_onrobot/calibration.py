"""Scales of a sensor, read over TCP before the stream begins."""

import asyncio
from contextlib import suppress

from hil_bridge.devices.wiring import Wiring
from hil_bridge.errors import DeviceError, TransportError
from hil_bridge.errors.event_kinds import EventKind
from hil_bridge.transports import connect_bytes
from hil_onrobot.messages import (
    CALIBRATION_SIZE,
    READ_CALIBRATION,
    TCP_REQUEST_SIZE,
    Calibration,
    decode_calibration,
)
from protocol.endpoint import RemoteProtocolError

_PATIENCE_S = 0.5
"""Longest wait for connection and answer, s. Chosen."""


async def read_calibration(url: str, wiring: Wiring) -> Calibration | None:
    """Return the scales of the sensor at a URL; None if it does not answer. Raises DeviceError for an invalid answer,
    and for other units than N and N·m.
    """
    try:
        async with asyncio.timeout(_PATIENCE_S):
            data = await _ask(url, wiring)
    except (TransportError, TimeoutError):
        wiring.log.notice(
            EventKind.LINK, f"{url}: the sensor does not report its scales; those of the settings hold"
        )
        return None
    try:
        return decode_calibration(data)
    except RemoteProtocolError as error:
        raise DeviceError(f"sensor on {url}: {error}", remedy="check its address, and its units") from error


async def _ask(url: str, wiring: Wiring) -> bytes:
    wire = await connect_bytes(url, wiring.clock)  # not the wire of the stream, which the log records
    answer: asyncio.Future[bytes] = wiring.clock.loop.create_future()
    received = bytearray()

    def receive(data: bytes) -> None:
        received.extend(data)
        if len(received) >= CALIBRATION_SIZE and not answer.done():
            answer.set_result(bytes(received[:CALIBRATION_SIZE]))

    def end(error: TransportError) -> None:
        if not answer.done():
            answer.set_exception(error)

    try:
        wire.start(receive, end)
        wire.send(bytes((READ_CALIBRATION,)).ljust(TCP_REQUEST_SIZE, b"\0"))
        return await answer
    finally:
        answer.cancel()
        with suppress(TransportError):
            await wire.aclose()
