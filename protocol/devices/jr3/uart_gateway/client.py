"""Client of a JR3 UART gateway: a GatewaySession over bytes.

The order of the session is state, full scales, start, a pause, and on request zero; stop at the end. The gateway
acknowledges a command and then sleeps for a second. Bytes sent during that second are lost, or remain in its driver
and hide later bytes. Every acknowledge, expected or not, is therefore followed by a pause, and a command without an
acknowledge is repeated only after more than that second.
"""

from protocol.devices.jr3.firmware import HANGS
from protocol.devices.jr3.gateway_session import Dialect, GatewaySession, OfSession, Phase
from protocol.devices.jr3.uart_gateway.messages import (
    FROM_GATEWAY,
    UART_BAUDRATE,
    Command,
    Op,
    decode_acknowledge,
    decode_data,
    encode_command,
)
from protocol.devices.jr3.uart_gateway.profile import UartGatewayClientProfile, check_uart_cutoff
from protocol.devices.jr3.uart_gateway.reader import Reader
from protocol.endpoint import Trouble

# Used with every sample, so bound to module names: before Python 3.12 an enum member lookup is five times slower.
_READY, _DATA, _ACKNOWLEDGE = Phase.READY, Op.DATA, Op.ACKNOWLEDGE

_STEPS = (
    (Phase.ASKING, Op.GET_STATE),
    (Phase.SCALES, Op.GET_FULL_SCALES),
    (Phase.STARTING, Op.START),
)


class UartGatewayClient(OfSession[Op]):
    """Endpoint of the client over a byte stream. It reports sensor events."""

    def __init__(self, profile: UartGatewayClientProfile, now: float) -> None:
        self._profile = profile
        self._reader = Reader(FROM_GATEWAY)
        self._frame_received_at = False
        super().__init__(GatewaySession(self._dialect(), profile, now))

    def _dialect(self) -> Dialect[Op]:
        return Dialect(
            name="UART gateway",
            steps=_STEPS,
            zero=Op.ZERO,
            set_filter=Op.SET_FILTER,
            stop=Op.STOP,
            pause_s=self._profile.pause_s,
            period=self._profile.period_ms * 1e-3,
            counter_step=self._profile.period_ms * 1e3 / self._profile.sample_period_us,
            counter_behind=0,  # bytes do not overtake each other: only an equal counter marks an old sample
            check_cutoff=check_uart_cutoff,
            explain_silence=self._explain_silence,
        )

    def _explain_silence(self, waited: str) -> Trouble:
        if self._frame_received_at:
            return Trouble(f"sends but acknowledges nothing for {waited}", "is the line to it open?")
        if self._reader.skipped:
            return Trouble(
                f"bytes but no frame of a gateway for {waited}",
                f"not {UART_BAUDRATE} baud, or another device?",
            )
        return Trouble(f"silent for {waited}", f"power, cable, port? {HANGS}")

    # --- wire

    def receive(self, data: bytes, now: float) -> None:
        """Process received bytes. Bytes that are not a frame of a gateway are skipped and counted."""
        reader, session = self._reader, self._session
        noises = reader.noises
        reader.feed(data)
        while (frame := reader.next_frame(scales_expected=session.scales_expected)) is not None:
            self._frame_received_at = True
            if frame.op is _DATA:
                if session.phase is _READY:
                    sample = decode_data(frame.payload)
                    session.sample(sample.counts, sample.counter, now)
            elif frame.op is _ACKNOWLEDGE:
                acknowledge = decode_acknowledge(frame.payload)
                session.acknowledge(acknowledge.state, acknowledge.full_scales, now)
            else:
                session.boot_up(now)
                self._frame_received_at = False
        self.statistics.malformed += reader.noises - noises

    def data_to_send(self, now: float) -> bytes:
        """Return the next command as a complete frame."""
        op = self._session.order_to_send(now)
        return b"" if op is None else self._bytes(op)

    def _bytes(self, op: Op) -> bytes:
        cutoff = round(self._session.cutoff_hz * 100)
        match op:
            case Op.START:
                return encode_command(Command(op, cutoff, round(self._profile.period_ms * 1000)))
            case Op.SET_FILTER:
                return encode_command(Command(op, cutoff))
            case _:
                return encode_command(Command(op))
