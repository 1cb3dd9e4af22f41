"""As much of HTTP 1.1 as the page of a Net F/T needs: one GET, and its answer."""

from protocol.devices.netft.page import PAGE, PAGE_LIMIT
from protocol.endpoint import RemoteProtocolError

_HEAD_LIMIT = 8192
"""Most bytes before the body. Chosen: a box sends some hundred."""
_END = b"\r\n\r\n"


class Page(bytes):
    """The page, or the reason why it did not come, on the way to the client of a sensor."""

    failure: str
    """Empty where it came."""

    def __new__(cls, body: bytes = b"", failure: str = "") -> "Page":
        """Hold the body of the answer, or in its place the reason for a failure, so that a recording shows it."""
        page = super().__new__(cls, body or failure.encode("utf-8"))
        page.failure = failure
        return page


def encode_get(host: str, path: str = PAGE) -> bytes:
    """Encode a request for a page of a host."""
    return f"GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n".encode("ascii", "replace")


def read_answer(data: bytes, ended: bool = False) -> bytes | None:
    """Body of the answer so far; None while more has to come. `ended` says that nothing more will.

    Raises RemoteProtocolError for an answer that is none, is too long or tells of an error.
    """
    head, end, body = data.partition(_END)
    if len(head) > _HEAD_LIMIT or len(body) > PAGE_LIMIT:
        raise RemoteProtocolError("its answer is too long")
    if not end:
        if ended:
            raise RemoteProtocolError("its answer is cut off")
        return None
    lines = head.split(b"\r\n")
    status = lines[0].split(b" ", 2)
    if not lines[0].startswith(b"HTTP/1.") or len(status) < 2:
        raise RemoteProtocolError("what answers speaks no HTTP")
    if status[1] != b"200":
        raise RemoteProtocolError(f"it answers {status[1][:9].decode('ascii', 'replace')!r} instead of 200")
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
        raise RemoteProtocolError("its answer is cut off")
    return body


def encode_answer(body: bytes, status: str = "200 OK", kind: str = "text/xml") -> bytes:
    """Encode an answer with this body."""
    head = f"HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {len(body)}\r\nConnection: close\r\n\r\n"
    return head.encode("ascii") + body


def read_get(data: bytes) -> str | None:
    """Path and query of a GET that came; None while more has to come.

    Raises RemoteProtocolError for a request that is too long or is no GET.
    """
    head, end, _ = data.partition(_END)
    if len(head) > _HEAD_LIMIT:
        raise RemoteProtocolError("the request is too long")
    if not end:
        return None
    parts = head.split(b"\r\n")[0].split(b" ")
    if len(parts) != 3 or parts[0] != b"GET" or not parts[2].startswith(b"HTTP/1."):
        raise RemoteProtocolError("the request is no GET")
    return parts[1].decode("ascii", "replace")
