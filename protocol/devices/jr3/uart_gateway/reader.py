"""Extractor of frames from a byte stream that may start at any byte and contain any bytes.

The op alone determines where a frame ends, except for an acknowledge, which has two possible lengths. The request
determines the length, so the client knows it, but no other reader of the line does. Without that knowledge, an
acknowledge is decoded as short in two cases: if `>` is at the end of the short form and `<` follows, or if `>` is
there and not at the end of the long form. A long acknowledge is mistaken for a short one only if fx has a full
scale of 15422 N.
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
    """Reader that skips bytes outside frames. After an invalid frame, it continues at the next `<`."""

    def __init__(self, ops: Collection[Op]) -> None:
        """Create a reader that recognises only frames with one of `ops`."""
        self._starts = {b"%b%02d" % (OPENING, op): (op, LAYOUTS[op][0].size + OVERHEAD) for op in ops}
        """Op and minimum frame size, by the first bytes of a frame."""
        self._waiting = b""
        self._at = 0
        """Number of buffered bytes that have been processed."""
        self._in_noise = False
        self.skipped = 0
        """Number of bytes that belong to no frame."""
        self.noises = 0
        """Number of unbroken runs of bytes that belong to no frame."""

    def feed(self, data: bytes) -> None:
        """Process received bytes."""
        self._waiting = self._waiting[self._at :] + data
        self._at = 0

    def next_frame(self, *, scales_expected: bool = True, ended: bool = False) -> Frame | None:
        """Return the next frame, or None until more data arrives. At most 17 bytes are buffered.

        `scales_expected` is false if the reader knows that no full scales were requested; a short acknowledge is
        then recognised at once. `ended` says that no more data follows; the buffered bytes are then decoded as they
        are.
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
            op, least = self._starts.get(waiting[self._at : payload], (None, _NO_FRAME))
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
        """Return the size of the frame that starts here; 0 if no frame does, and None if more data is needed to
        determine it.
        """
        size = self._is_closed_at(least, ended) if op is not None else _NO_FRAME
        if op is not Op.ACKNOWLEDGE or size is None or (size and not scales_expected):
            return size
        if size and self._waiting[self._at + size : self._at + size + 1] == OPENING:
            return size
        long = self._is_closed_at(_LONG, ended)
        return long if long is None else long or size

    def _is_closed_at(self, size: int, ended: bool) -> int | None:
        end = self._at + size
        if len(self._waiting) < end:
            return _NO_FRAME if ended else None
        return size if self._waiting[end - 1 : end] == CLOSING else _NO_FRAME
