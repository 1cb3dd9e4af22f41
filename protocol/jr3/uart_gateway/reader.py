"""Frames out of a stream of bytes that may begin anywhere and hold anything.

Where a frame ends is known by its op alone. Only an acknowledge has two lengths, and which one comes is known
by what was asked, thus to the client and to nobody else on the line. Read without that knowledge, an
acknowledge is short when `>` stands where the short one ends and either `<` comes after it or no `>` stands
where the long one would end. To take a long one for short, fx would have to have a full scale of 15422 N.
"""

from collections.abc import Collection

from protocol.jr3.uart_gateway.messages import (
    CLOSING,
    HEAD_SIZE,
    LAYOUTS,
    OPENING,
    OVERHEAD,
    Frame,
    Op,
)

_SHORT, _LONG = (layout.size + OVERHEAD for layout in LAYOUTS[Op.ACKNOWLEDGE])
_NO_FRAME = 0


class Reader:
    """A byte that begins no frame is skipped; whatever claimed to be one and is not is searched for the next `<`."""

    def __init__(self, ops: Collection[Op]) -> None:
        """`ops` are those that can come: what has another is no frame."""
        self._ops = {b"%b%02d" % (OPENING, op): op for op in ops}
        self._waiting = bytearray()
        self._in_noise = False
        self.skipped = 0
        """Bytes that belong to no frame."""
        self.noises = 0
        """Unbroken runs of such bytes."""

    def feed(self, data: bytes) -> None:
        """Take what arrived."""
        self._waiting += data

    def next_frame(self, *, scales_expected: bool = True, ended: bool = False) -> Frame | None:
        """The next frame, or None until more arrives; at most 17 bytes wait for more.

        `scales_expected` is false for who knows that no full scales were asked for: a short acknowledge is then
        known at once. `ended` says that nothing more will come: what waits is read for what it is.
        """
        while True:
            opening = self._waiting.find(OPENING)
            self._skip(len(self._waiting) if opening < 0 else opening)
            size = self._size(scales_expected, ended)
            if size is None:
                return None
            if size:
                frame = Frame(
                    self._ops[bytes(self._waiting[:HEAD_SIZE])], bytes(self._waiting[HEAD_SIZE : size - 1])
                )
                del self._waiting[:size]
                self._in_noise = False
                return frame
            self._skip(1)

    def _skip(self, count: int) -> None:
        if not count:
            return
        del self._waiting[:count]
        self.skipped += count
        self.noises += not self._in_noise
        self._in_noise = True

    def _size(self, scales_expected: bool, ended: bool) -> int | None:
        """Bytes of the frame that begins here, 0 when none does, None when more must come to tell."""
        if len(self._waiting) < HEAD_SIZE:
            return _NO_FRAME if ended and self._waiting else None
        op = self._ops.get(bytes(self._waiting[:HEAD_SIZE]))
        if op is None:
            return _NO_FRAME
        if op is Op.ACKNOWLEDGE:
            return self._acknowledge_size(scales_expected, ended)
        return self._closed_at(LAYOUTS[op][0].size + OVERHEAD, ended)

    def _acknowledge_size(self, scales_expected: bool, ended: bool) -> int | None:
        short = self._closed_at(_SHORT, ended)
        if short is None or (short and not scales_expected):
            return short
        if short and self._waiting[short : short + 1] == OPENING:
            return short
        long = self._closed_at(_LONG, ended)
        return long if long is None else long or short

    def _closed_at(self, size: int, ended: bool) -> int | None:
        if len(self._waiting) < size:
            return _NO_FRAME if ended else None
        return size if self._waiting[size - 1 : size] == CLOSING else _NO_FRAME
