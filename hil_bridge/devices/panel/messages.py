"""Messages on the control socket: one JSON object per line, requests and answers alternating.

An answer contains either the requested values or `error`, a one-line message.
"""

import json
from collections.abc import Mapping
from typing import Any

REQUEST_LIMIT = 1024
"""Longest request in bytes. Chosen."""
ANSWER_LIMIT = 65536
"""Longest answer in bytes. Chosen."""


def encode(message: Mapping[str, Any]) -> bytes:
    """Return the message as a line, including its end."""
    return json.dumps(message, separators=(",", ":")).encode() + b"\n"


def decode(line: bytes) -> dict[str, Any]:
    """Return the object of a line. Raises ValueError for a line that is not a JSON object."""
    try:
        message = json.loads(line)
    except (ValueError, RecursionError):
        raise ValueError("this is not a line of JSON") from None
    if not isinstance(message, dict):
        raise ValueError("this is not a JSON object")
    return message
