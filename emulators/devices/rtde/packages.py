"""The pieces on the cable of a controller, as faults see them.

A stream over TCP loses and changes no bytes. So faults strike what one side says: a package of RTDE, or a message to
and from the dashboard and the script port.
"""

from emulators.faults.packets import packages
from protocol.devices.rtde.packets import HEADER


def _packages_of(data: bytes) -> list[bytes]:
    """Whole packages of RTDE; what is none is one more, for a client may say anything."""
    found, at = list[bytes](), 0
    while len(data) - at >= HEADER.size:
        size, _ = HEADER.unpack_from(data, at)
        if size < HEADER.size:
            break
        found.append(data[at : at + size])
        at += size
    return [*found, data[at:]] if at < len(data) else found


PACKAGES = packages("packages", _packages_of)
"""Of the RTDE port."""
MESSAGES = packages("messages", lambda data: [data] if data else [])
"""Of the other ports."""
