"""Frames out of a stream of bytes that may begin anywhere and hold anything.

Where a frame ends is known by its op alone. Only an acknowledge has two lengths. The request decides between them, so
the client knows it, and no other reader of the line. Read without that knowledge, an acknowledge is short in two cases:
`>` stands where the short one ends and `<` comes after it, or `>` stands there and no `>` stands where the long one
would end. To take a long one for short, fx would have to have a full scale of 15422 N.
"""

from collections.abc import Collection

from protocol.devices.jr3.uart_gateway.messages import (
    CLOSING,
    HEAD_SIZE,
    LAYOUTS,
    OPENING,
    OVERHEAD,
    Frame,
    Op,
)

_LONG = LAYOUTS[Op.ACKNOWLEDGE][-1].size + OVERHEAD
_NO_FRAME = 0


class Reader:
    """A byte that begins no frame is skipped; whatever claimed to be one and is not is searched for the next `<`."""

    def __init__(self, ops: Collection[Op]) -> None:
        """`ops` are those that can come: what has another is no frame."""
        self._begins = {b"%b%02d" % (OPENING, op): (op, LAYOUTS[op][0].size + OVERHEAD) for op in ops}
        """Bytes that a frame may begin with, with its op and least size."""
        self._waiting = b""
        self._at = 0
        """Number of the waiting bytes that have been read."""
        self._in_noise = False
        self.skipped = 0
        """Bytes that belong to no frame."""
        self.noises = 0
        """Unbroken runs of such bytes."""

    def feed(self, data: bytes) -> None:
        """Take what arrived."""
        self._waiting = self._waiting[self._at :] + data
        self._at = 0

    def next_frame(self, *, scales_expected: bool = True, ended: bool = False) -> Frame | None:
        """Return the next frame, or None until more arrives; at most 17 bytes wait for more.

        `scales_expected` is false for a reader that knows that no full scales were asked for: it then knows a short
        acknowledge at once. `ended` says that nothing more will come: what waits is read for what it is.
        """
        waiting = self._waiting
        if self._at == len(waiting):
            return None
        while True:
            begin = waiting.find(OPENING, self._at)
            if begin != self._at:
                self._skip((len(waiting) if begin < 0 else begin) - self._at)
            payload = self._at + HEAD_SIZE
            if len(waiting) < payload and not (ended and self._at < len(waiting)):
                return None
            op, least = self._begins.get(waiting[self._at : payload], (None, _NO_FRAME))
            size = self._size(op, least, scales_expected, ended)
            if size is None:
                return None
            if op is not None and size:
                self._at += size
                self._in_noise = False
                return Frame(op, waiting[payload : self._at - 1])
            self._skip(1)

    def _skip(self, count: int) -> None:
        if not count:
            return
        self._at += count
        self.skipped += count
        self.noises += not self._in_noise
        self._in_noise = True

    def _size(self, op: Op | None, least: int, scales_expected: bool, ended: bool) -> int | None:
        """Bytes of the frame that begins here, 0 when none does, None when more must come to tell."""
        size = self._closed_at(least, ended) if op is not None else _NO_FRAME
        if op is not Op.ACKNOWLEDGE or size is None or (size and not scales_expected):
            return size
        if size and self._waiting[self._at + size : self._at + size + 1] == OPENING:
            return size
        long = self._closed_at(_LONG, ended)
        return long if long is None else long or size

    def _closed_at(self, size: int, ended: bool) -> int | None:
        end = self._at + size
        if len(self._waiting) < end:
            return _NO_FRAME if ended else None
        return size if self._waiting[end - 1 : end] == CLOSING else _NO_FRAME
