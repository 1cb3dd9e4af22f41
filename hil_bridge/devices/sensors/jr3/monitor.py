"""Monitor of the CAN bus of a JR3 gateway, frame by frame."""

import asyncio
from functools import partial

from hil_bridge.clock import Clock, run_real
from hil_bridge.console.printing import Printer, Row, end, field_text, stop_on_signals
from hil_bridge.transports import Frames, connect_can
from protocol.can.error import decode_error
from protocol.can.frame import CanFrame
from protocol.can.line import line_bits
from protocol.devices.jr3 import GATEWAY_BITRATE, describe


def monitor_can(url: str, raw: bool) -> None:
    """Print the frames on the bus of a JR3 gateway until Ctrl-C. Errors as for the monitor of a link."""
    run_real(lambda: listen_can(url, Printer(raw)))


async def listen_can(url: str, show: Printer) -> None:
    """Print the frames on a bus until a signal arrives or the bus ends. Errors as for `monitor_can`."""
    clock = Clock.running()

    def arrived(frames: Frames) -> None:
        for frame in frames:
            at = clock.now() if frame.received_at is None else frame.received_at
            if frame.error:
                show.row(Row(at, "bus", str(decode_error(frame)), trouble=True))
                continue
            direction, text, trouble = frame_text(frame)
            line_time = line_bits(frame) / GATEWAY_BITRATE
            show.row(Row(at, direction, text, frame.data, trouble, line_time))

    try:
        wire = await connect_can(url, clock)
        ended: asyncio.Future[None] = clock.loop.create_future()
        try:
            wire.start(arrived, partial(end, ended))
            stop_on_signals(clock, ended)
            await ended
        finally:
            await wire.aclose()
    finally:
        clock.close()


def frame_text(frame: CanFrame) -> tuple[str, str, bool]:
    """Return direction and description of a frame of a JR3 gateway, and whether the frame has problems."""
    description = describe(frame)
    fields, problems = description["fields"], description["problems"]
    assert isinstance(fields, list)
    assert isinstance(problems, list)
    node = f" node {description['node']}" if description["node"] else ""
    head = f"{description['op']}{node}" if description["op"] else str(frame)
    values = ", ".join(filter(None, (field_text(field, zeros=True) for field in fields)))
    text = ": ".join(filter(None, (head, values)))
    direction = {"from gateway": "JR3→PC", "to gateway": "PC→JR3"}.get(str(description["direction"]), "?")
    return direction, "; ".join((text, *problems)), bool(problems)
