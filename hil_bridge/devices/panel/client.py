"""Client of the panel: one request per connection."""

import socket
from collections.abc import Mapping
from typing import Any

from hil_bridge.devices.panel.messages import ANSWER_LIMIT, decode, encode
from hil_bridge.errors import ConfigError, DeviceError, TransportUnavailable
from hil_bridge.transports.urls import CONNECT_BYTES, parse_url

TIMEOUT_S = 5.0
"""Time-out for an answer of the panel, s. Chosen: the panel answers at once, even on a busy computer."""

_SCHEMES = {"tcp": CONNECT_BYTES["tcp"]}


def ask(url: str, request: Mapping[str, Any]) -> dict[str, Any]:
    """Send a request and return the panel's answer.

    Raises ConfigError for an invalid URL or request, TransportUnavailable if no panel listens, DeviceError for an
    invalid answer.
    """
    address = parse_url(url, _SCHEMES).host_port
    try:
        with socket.create_connection(address, TIMEOUT_S) as connection:
            connection.sendall(encode(request))
            line = _line(connection)
    except OSError as error:
        raise TransportUnavailable(
            f"{url}: no panel answers ({error.strerror or error}); start one with `hil-bridge emulate cell "
            "--panel tcp-listen://127.0.0.1:0` and use the URL that it prints"
        ) from error
    try:
        answer = decode(line)
    except ValueError as error:
        raise DeviceError(f"{url} is not a panel: {error}; check the URL") from error
    if "error" in answer:
        raise ConfigError(f"{url}: {answer['error']}")
    return answer


def _line(connection: socket.socket) -> bytes:
    """Read up to the end of the line, the end of the connection, or the size limit."""
    data = b""
    while b"\n" not in data and len(data) < ANSWER_LIMIT:
        if not (more := connection.recv(4096)):
            break
        data += more
    return data.partition(b"\n")[0]
