"""Messages on the control socket: one JSON object per line, requests and answers alternating.

An answer contains either the requested values or `error`, a one-line message.
"""

import json
from collections.abc import Mapping
from typing import Any

REQUEST_LIMIT = 1024
"""Maximum length of a request, bytes. Chosen."""
ANSWER_LIMIT = 65536
"""Maximum length of an answer, bytes. Chosen."""


def encode(message: Mapping[str, Any]) -> bytes:
    """Return the message as a line, including the line ending."""
    return json.dumps(message, separators=(",", ":")).encode() + b"\n"


def decode(line: bytes) -> dict[str, Any]:
    """Return the object that a line contains. Raises ValueError if the line is not a JSON object."""
    try:
        message = json.loads(line)
    except (ValueError, RecursionError):
        raise ValueError("this is not a line of JSON") from None
    if not isinstance(message, dict):
        raise ValueError("this is not a JSON object")
    return message
