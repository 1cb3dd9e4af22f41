"""End of a TCP connection at an emulated OnRobot HEX: it answers requests of 20 bytes."""

from typing import TYPE_CHECKING

from hil_onrobot.messages import (
    READ,
    READ_CALIBRATION,
    TCP_REQUEST_SIZE,
    encode_calibration,
    encode_reading,
)

if TYPE_CHECKING:
    from hil_onrobot.sensor import HexSensor


class Connection:
    """Connection of one client, an endpoint of bytes."""

    closing = False
    """Whether the sensor closes the connection. It never does (assumed)."""

    def __init__(self, sensor: "HexSensor") -> None:
        self._sensor = sensor
        self._received = self._out = b""

    def receive(self, data: bytes, now: float) -> None:
        """Answer complete requests. Unknown commands are ignored (assumed)."""
        if now < self._sensor.ready_at:
            self._received = b""
            return
        self._received += data
        while len(self._received) >= TCP_REQUEST_SIZE:
            command, self._received = self._received[0], self._received[TCP_REQUEST_SIZE:]
            self._out += self._answer(command, now)

    def _answer(self, command: int, now: float) -> bytes:
        sensor = self._sensor
        if command == READ:
            return encode_reading(*sensor.read(now), sensor.calibration)
        if command == READ_CALIBRATION:
            return encode_calibration(sensor.calibration)
        sensor.unmodelled.touch(f"command {command:02X} over TCP", "ignored")
        return b""

    def data_to_send(self, now: float) -> bytes:
        """Return the answers, once."""
        out, self._out = self._out, b""
        return out

    def next_event(self) -> None:
        """Return None: there are no events."""

    def next_deadline(self) -> float | None:
        """Return None: nothing is due without a request."""
        return None

    def handle_deadline(self, now: float) -> None:
        """Do nothing: there is no deadline."""

    def close(self, now: float) -> None:
        """Report the end of the connection to the sensor."""
        self._sensor.leave(self)
