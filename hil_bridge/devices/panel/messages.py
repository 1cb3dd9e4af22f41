"""Messages on the control socket: one JSON object a line, a request and its answer in turn.

An answer holds either what was asked for or `error`, one line for people.
"""

import json
from collections.abc import Mapping
from typing import Any

REQUEST_LIMIT = 1024
"""Longest request in bytes. Mark: chosen."""
ANSWER_LIMIT = 65536
"""Longest answer in bytes. Mark: chosen."""


def encode(message: Mapping[str, Any]) -> bytes:
    """The line, with its end."""
    return json.dumps(message, separators=(",", ":")).encode() + b"\n"


def decode(line: bytes) -> dict[str, Any]:
    """Object in a line. Raises ValueError for a line that is no JSON object."""
    try:
        message = json.loads(line)
    except (ValueError, RecursionError):
        raise ValueError("this is no line of JSON") from None
    if not isinstance(message, dict):
        raise ValueError("this is no JSON object")
    return message
