"""Client of a JR3 CAN gateway: a GatewaySession over CAN frames.

The session uses the same order as the gateway's YARP client: state, start, full scales, a pause, and on request
zero; stop at the end. The gateway is always ready to receive.
"""

from collections.abc import Sequence

from protocol.can.error import decode_error
from protocol.can.frame import CanFrame
from protocol.devices.jr3.can_gateway.messages import (
    FORCES,
    MOMENTS,
    Command,
    Op,
    decode_acknowledge,
    encode_command,
    identifier,
)
from protocol.devices.jr3.can_gateway.profile import GatewayClientProfile
from protocol.devices.jr3.firmware import HANGS, TESTED_PERIOD_MS, check_cutoff
from protocol.devices.jr3.gateway_session import Dialect, GatewaySession, OfSession, Phase
from protocol.endpoint import RemoteProtocolError, Trouble

STRAGGLER_S = 0.5
"""Largest backward step of the counter that marks an old frame, as a time, s. Chosen. A larger step counts as a
large step forward.
"""

_READY = Phase.READY


class GatewayClient(OfSession[Op]):
    """Endpoint of the client: exchanges sequences of CAN frames and reports sensor events."""

    def __init__(self, profile: GatewayClientProfile, now: float) -> None:
        self._profile = profile
        self._force_id = identifier(Op.FORCES, profile.node)
        self._moment_id = identifier(Op.MOMENTS, profile.node)
        self._acknowledge_id = identifier(Op.ACKNOWLEDGE, profile.node)
        self._boot_up_id = identifier(Op.BOOT_UP, profile.node)
        self._others_heard = False
        self._forces: bytes | None = None
        super().__init__(session := GatewaySession(self._dialect(), profile, now))
        if profile.period_ms < TESTED_PERIOD_MS:
            session.notice(
                f"period_ms is {profile.period_ms:g}, but the gateway's firmware was tested from "
                f"{TESTED_PERIOD_MS:g} on: below that it may have no time left for anything else"
            )

    def _dialect(self) -> Dialect[Op]:
        period = self._profile.period_ms * 1e-3
        samples_per_second = 1e6 / self._profile.sample_period_us
        return Dialect(
            name=f"gateway node {self._profile.node}",
            steps=(
                (Phase.ASKING, Op.GET_STATE),
                (Phase.STARTING, Op.START_ASYNC),
                (Phase.FORCE_SCALES, Op.GET_FORCE_FULL_SCALES),
                (Phase.MOMENT_SCALES, Op.GET_MOMENT_FULL_SCALES),
            ),
            zero=Op.ZERO,
            set_filter=Op.SET_FILTER,
            stop=Op.STOP,
            pause_s=None,
            period=period,
            counter_step=period * samples_per_second,
            counter_behind=int(STRAGGLER_S * samples_per_second),
            check_cutoff=check_cutoff,
            explain_silence=self._explain_silence,
        )

    def _explain_silence(self, waited: str) -> Trouble:
        if self._others_heard:
            return Trouble(f"silent for {waited} while other nodes are on the bus", "wrong node number?")
        return Trouble(
            f"silent: no frame of a gateway on the bus for {waited}", f"power, bit rate, wiring? {HANGS}"
        )

    # --- wire

    def receive(self, data: Sequence[CanFrame], now: float) -> None:
        """Process received frames. Frames of other nodes and ops are ignored; bus error reports become notices."""
        for frame in data:
            if frame.error:
                self._on_error_report(frame)
                continue
            if frame.extended or frame.remote:
                continue
            number = frame.identifier
            if number == self._force_id:
                self._on_forces(frame)
            elif number == self._moment_id:
                self._on_moments(frame, now)
            elif number == self._acknowledge_id:
                self._on_acknowledge(frame, now)
            elif number == self._boot_up_id:
                self._forces = None
                self._session.boot_up(now)
            else:
                self._others_heard = True

    def data_to_send(self, now: float) -> Sequence[CanFrame]:
        """Return the frame of the next command."""
        op = self._session.order_to_send(now)
        return [] if op is None else [self._frame(op)]

    def _frame(self, op: Op) -> CanFrame:
        node, cutoff = self._profile.node, round(self._session.cutoff_hz * 100)
        match op:
            case Op.START_ASYNC:
                return encode_command(Command(op, node, cutoff, round(self._profile.period_ms * 1000)))
            case Op.SET_FILTER:
                return encode_command(Command(op, node, cutoff))
            case _:
                return encode_command(Command(op, node))

    def _on_error_report(self, frame: CanFrame) -> None:
        try:
            self._session.notice(f"CAN bus: {decode_error(frame)}")
        except RemoteProtocolError:
            self.statistics.malformed += 1

    def _on_acknowledge(self, frame: CanFrame, now: float) -> None:
        try:
            acknowledge = decode_acknowledge(frame.data)
        except RemoteProtocolError:
            self.statistics.malformed += 1
            return
        self._session.acknowledge(acknowledge.state, acknowledge.full_scales, now)

    # --- samples: two frames each, up to 1 kHz, so only what is used is decoded

    def _on_forces(self, frame: CanFrame) -> None:
        if self._session.phase is not _READY:
            return
        if len(frame.data) < FORCES.size:
            self.statistics.malformed += 1
            return
        if self._forces is not None:
            self.statistics.unpaired += 1
        self._forces = frame.data

    def _on_moments(self, frame: CanFrame, now: float) -> None:
        if self._session.phase is not _READY:
            return
        if len(frame.data) < MOMENTS.size:
            self.statistics.malformed += 1
            return
        if self._forces is None or self._forces[6:] != frame.data[6:]:
            self.statistics.unpaired += 1
            return
        fx, fy, fz, counter = FORCES.unpack_row(self._forces)
        mx, my, mz, _ = MOMENTS.unpack_row(frame.data)
        self._forces = None
        at = now if frame.received_at is None else frame.received_at
        self._session.sample((fx, fy, fz, mx, my, mz), counter, at)
