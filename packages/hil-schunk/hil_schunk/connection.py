"""End of a TCP connection at an emulated SCHUNK FTS: it answers commands."""

from collections.abc import Hashable
from typing import TYPE_CHECKING

from hil_schunk.messages import MessageReader, encode_message

if TYPE_CHECKING:
    from hil_schunk.sensor import FtsSensor

_SHORT = 4
"""Length of an answer that is cut off, bytes. Assumed."""


class Connection:
    """Connection of one client, an endpoint of bytes. It counts its answers from 1."""

    def __init__(self, sensor: "FtsSensor", side: Hashable) -> None:
        self._sensor = sensor
        self.side = side
        """Address to which the sensor sends packets for this client."""
        self.is_dead = False
        """Whether the sensor has lost the connection in a reboot. The client does not know yet."""
        self._reader = MessageReader()
        self._answers = 0
        self._out = b""
        self.closing = False
        """Whether the sensor closes the connection."""

    def receive(self, data: bytes, now: float) -> None:
        """Answer the commands, which may change the stream."""
        if self._sensor.is_cut(("off", "deaf"), now) or now < self._sensor.ready_at:
            return
        if self.is_dead:
            self.closing = True  # as a computer that receives data for a connection that it does not have
            return
        for message in self._reader.feed(data):
            answer = self._sensor.answer(message.payload, self, now)
            if answer:
                self._answers += 1
                self._out += self._sensor.cut_short(encode_message(self._answers, answer), _SHORT, now)
        self._sensor.on_change()

    def data_to_send(self, now: float) -> bytes:
        """Return the answers, once."""
        out, self._out = self._out, b""
        return b"" if out and self._sensor.is_cut(("off", "mute"), now) else out

    def next_event(self) -> None:
        """Return None: there are no events."""

    def next_deadline(self) -> float | None:
        """Return None: nothing is due without a command."""
        return None

    def handle_deadline(self, now: float) -> None:
        """Do nothing: there is no deadline."""

    def close(self, now: float) -> None:
        """Report the end of the connection to the sensor."""
        self._sensor.leave(self, now)
