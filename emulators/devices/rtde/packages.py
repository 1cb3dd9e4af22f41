"""Units on a controller's cable to which faults apply.

A stream over TCP neither loses nor changes bytes. Faults therefore affect complete messages in one direction: an
RTDE package, or a message to or from the dashboard or the script port.
"""

from emulators.faults.packets import packages
from protocol.devices.rtde.packets import HEADER


def _packages_of(data: bytes) -> list[bytes]:
    """Split data into complete RTDE packages. Invalid data forms one more unit, since a client may send any data."""
    packages, at = list[bytes](), 0
    while len(data) - at >= HEADER.size:
        size, _ = HEADER.unpack_from(data, at)
        if size < HEADER.size:
            break
        packages.append(data[at : at + size])
        at += size
    return [*packages, data[at:]] if at < len(data) else packages


PACKAGES = packages("packages", _packages_of)
"""Units of the RTDE port to which faults apply."""
MESSAGES = packages("messages", lambda data: [data] if data else [])
"""Units of the other ports to which faults apply."""
