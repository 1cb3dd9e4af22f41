"""Subset of HTTP 1.1 that the page of a Net F/T needs: one GET request, and its response."""

from protocol.devices.netft.page import PAGE, PAGE_LIMIT
from protocol.endpoint import RemoteProtocolError

_HEAD_LIMIT = 8192
"""Maximum number of bytes before the body. Chosen: a box sends some hundred bytes."""
_END = b"\r\n\r\n"


class Page(bytes):
    """Configuration page, or the reason why it did not arrive, as passed to the client of a sensor."""

    failure: str
    """Reason why the page did not arrive; empty if it arrived."""

    def __new__(cls, body: bytes = b"", failure: str = "") -> "Page":
        """Create a page from the body of the response or, if it did not arrive, from the reason, so that a
        recording contains the reason.
        """
        page = super().__new__(cls, body or failure.encode("utf-8"))
        page.failure = failure
        return page


def encode_get(host: str, path: str = PAGE) -> bytes:
    """Encode a GET request for a page of a host."""
    return f"GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n".encode("ascii", "replace")


def read_answer(data: bytes, ended: bool = False) -> bytes | None:
    """Return the body of the response; None if the response is incomplete. `ended` says that no more data follows.

    Raises RemoteProtocolError if the response is invalid, too long, or reports an error.
    """
    head, end, body = data.partition(_END)
    if len(head) > _HEAD_LIMIT or len(body) > PAGE_LIMIT:
        raise RemoteProtocolError("its response is too long")
    if not end:
        if ended:
            raise RemoteProtocolError("its response is truncated")
        return None
    lines = head.split(b"\r\n")
    status = lines[0].split(b" ", 2)
    if not lines[0].startswith(b"HTTP/1.") or len(status) < 2:
        raise RemoteProtocolError("the peer does not use HTTP")
    if status[1] != b"200":
        raise RemoteProtocolError(
            f"it responds with {status[1][:9].decode('ascii', 'replace')!r} instead of 200"
        )
    length = None
    for line in lines[1:]:
        name, _, value = line.partition(b":")
        value = value.strip()
        if name.strip().lower() == b"content-length" and value.isdigit() and len(value) < 9:
            length = int(value)
    if length is not None and len(body) >= length:
        return body[:length]
    if not ended:
        return None
    if length is not None:
        raise RemoteProtocolError("its response is truncated")
    return body


def encode_answer(body: bytes, status: str = "200 OK", kind: str = "text/xml") -> bytes:
    """Encode a response with this body."""
    head = f"HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {len(body)}\r\nConnection: close\r\n\r\n"
    return head.encode("ascii") + body


def read_get(data: bytes) -> str | None:
    """Return the path and query of a GET request; None if the request is incomplete.

    Raises RemoteProtocolError if the request is too long or is not a GET.
    """
    head, end, _ = data.partition(_END)
    if len(head) > _HEAD_LIMIT:
        raise RemoteProtocolError("the request is too long")
    if not end:
        return None
    parts = head.split(b"\r\n")[0].split(b" ")
    if len(parts) != 3 or parts[0] != b"GET" or not parts[2].startswith(b"HTTP/1."):
        raise RemoteProtocolError("the request is not a GET")
    return parts[1].decode("ascii", "replace")
