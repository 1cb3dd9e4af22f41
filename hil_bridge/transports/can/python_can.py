"""Opening of python-can interfaces."""

import asyncio
import errno
import os
from collections.abc import Sequence
from functools import partial
from typing import Any

import can

from hil_bridge.clock import Clock
from hil_bridge.transports import reasons
from hil_bridge.transports.base import Frames, Transport
from hil_bridge.transports.can.socketcan import SocketCanLink, interface_up
from hil_bridge.transports.can.wire import CanWire, Place
from hil_bridge.transports.delivery import QUEUE_FRAMES
from hil_bridge.transports.urls import WireUrl
from protocol.can.frame import CanFilter


async def open_python_can(url: WireUrl, clock: Clock, accept: Sequence[CanFilter] = ()) -> Transport[Frames]:
    """Open an interface: `can+socketcan` or `can+virtual`. Raises TransportUnavailable if it cannot be opened."""
    place = Place(url.scheme.removeprefix("can+"), url.target, url.name)
    interface, channel, name = place
    open_bus = partial(_open, interface, channel, accept, dict(url.options))
    opening = asyncio.ensure_future(asyncio.to_thread(open_bus))
    try:
        bus = await asyncio.shield(opening)
    except asyncio.CancelledError:
        # the thread cannot be stopped: a bus that it opens must be closed afterwards
        opening.add_done_callback(_close_opened)
        raise
    except (can.CanError, OSError, ValueError) as error:
        raise reasons.unavailable(f"can+{interface}", name, channel, error) from error
    link = SocketCanLink(channel, open_bus) if interface == "socketcan" else None
    return CanWire(bus, place, clock, link)


def _open(interface: str, channel: str, accept: Sequence[CanFilter], options: dict[str, Any]) -> can.BusABC:
    match interface:
        case "virtual":
            options = {"rx_queue_size": QUEUE_FRAMES, **options}
        case "socketcan":
            # error frames are on unless they are declined; a socket can be bound to an interface that is down
            if (up := interface_up(channel)) is not True:
                # python-can would detect it too, but leave its socket open
                number = errno.ENODEV if up is None else errno.ENETDOWN
                raise OSError(number, os.strerror(number))
    filters = [
        {"can_id": choice.identifier, "can_mask": choice.mask, "extended": choice.extended}
        for choice in accept
    ]
    return can.Bus(
        channel=channel, interface=interface, ignore_config=True, can_filters=filters or None, **options
    )


def _close_opened(opening: "asyncio.Future[can.BusABC]") -> None:
    if not opening.cancelled() and opening.exception() is None:
        opening.result().shutdown()
