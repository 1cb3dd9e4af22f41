"""The client's end: each telegram of the robot is answered once, with the correction that the newest set point needs.

A correction is the way from where the robot would be without it, in the base frame: X Y Z in mm, and angles A B C in
degrees whose turn comes after the robot's own, R = R(A B C)·R₀. In absolute mode an answer carries the whole
correction, in relative mode its change since the answer that the robot has taken last.

Its count of late answers tells which ones it has taken. So those after a lost answer make good for it, little by
little, and the set point and the robot stay together. A telegram that comes again, or behind a later one, gets no
answer: its cycle is over, and an increment must not count twice.

Source: project specification of RSI, sections 3, 5 and 9.
"""

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

from protocol.datagram import arrived_at
from protocol.devices.rsi.axis_channel import NO_TURN, AxisChannel, Programmed
from protocol.devices.rsi.continuity import SESSION_MS, Arrival, Continuity
from protocol.devices.rsi.corrections import (
    NO_CORRECTION,
    Correction,
    clamp,
    correction_for,
    step_towards,
)
from protocol.devices.rsi.elements import axis_tags, pose_tags
from protocol.devices.rsi.profile import RsiLink
from protocol.devices.rsi.response import Response
from protocol.devices.rsi.robot_telegram import RobotTelegram, read_telegram
from protocol.devices.rsi.telegram import SENSOR, Telegram, encode, fixed
from protocol.endpoint import NO_TROUBLE, RemoteProtocolError, Trouble
from protocol.geometry import Pose
from protocol.kinematics import Joints
from protocol.robot import ReportReceived, RobotReport, StreamEvent, StreamLost, StreamNotice

DECIMALS = 6
"""Observed: decimals of every number that public clients send."""
STANDING_MM = 0.05
"""Chosen: a difference between actual and set position below it is none when a session begins."""
STANDING_DEG = 0.01
"""Chosen: the same of their turn, and of each axis where the axes are corrected."""
_RENUMBERED = Trouble("its clock jumped", "see which program sends to this port")


class _Answered(NamedTuple):
    """The answer that was given last."""

    ipoc: int
    late: int | None
    before: Correction
    """Correction of the robot if it has not taken this answer."""
    axes_before: Joints
    """That of its axes, where they are corrected."""


class RsiClient:
    """A `StreamClient` for a controller that opens the conversation."""

    def __init__(self, link: RsiLink) -> None:
        self._link = link
        self._events: deque[StreamEvent] = deque()
        self._out: list[bytes] = []
        self._unanswered: deque[int] = deque()
        """Clocks of the telegrams that were told and not answered yet."""
        self._continuity, self._response = Continuity(link), Response(link)
        self._axes_offset: Joints = NO_TURN
        """Correction of the axes that the newest telegram shows, where they are corrected."""
        self._answered: _Answered | None = None
        self._total: Correction = NO_CORRECTION
        """Correction that the robot has, as far as is known."""
        self._aim: Correction = NO_CORRECTION
        """Correction that the newest set point asked for."""
        self._began: tuple[Pose, Correction] | None = None
        """Pose and correction at which the movement began; None outside of one."""
        self._garbled = self._limited = False
        self._axes: AxisChannel | None = AxisChannel(link) if link.correction == "axes" else None
        self._tags = axis_tags(link.axis_tag) if self._axes else pose_tags(link.correction_tag)

    # --- as an endpoint

    def receive(self, data: Sequence[bytes], now: float) -> None:
        for datagram in data:
            try:
                telegram = read_telegram(datagram, self._axes is not None)
            except RemoteProtocolError as error:
                if not self._garbled:
                    self._tell("garbled", f"a telegram is not understood: {error}")
                self._garbled = True
                continue
            self._garbled = False
            self._take(telegram, arrived_at(datagram, now))

    def next_event(self) -> StreamEvent | None:
        return self._events.popleft() if self._events else None

    def data_to_send(self, now: float) -> Sequence[bytes]:
        out, self._out = self._out, []
        return out

    def next_deadline(self) -> float | None:
        return None

    def handle_deadline(self, now: float) -> None:
        """There is none: the robot drives the cycle."""

    # --- movements

    def begin(self, pose: Pose) -> None:
        offset = self._response.offset
        if self._response.strayed and offset is not None:
            self._set(offset, self._axes_offset)  # as it did not come along, continue from where it is
        self._began, self._aim = (pose, self._total), self._total
        self._limited = False
        self._response.begin_movement()

    def end(self) -> None:
        self._began = None

    def target(self, pose: Pose, now: float) -> None:
        if not self._in_time():
            return
        total, before = self._total, self._aim
        self._aim = total
        if self._began is not None and not self._response.halted:
            self._aim = correction_for(pose, self._began, total)
        bounded = clamp(self._aim, self._link)
        if not self._limited and math.dist(bounded, self._aim) > 1e-9:
            self._limited = True
            self._tell(
                "correction",
                f"the correction stays within {self._link.limit_mm:g} mm and {self._link.limit_deg:g}° of the robot's "
                "program; begin nearer, or raise limit_mm, limit_deg and POSCORR's limits",
            )
        change = tuple([to - was for to, was in zip(self._aim, before, strict=True)])
        self._answer(step_towards(bounded, total, change, self._link))

    def hold(self, now: float) -> None:
        if self._in_time():
            self._answer(self._total)

    def _in_time(self) -> bool:
        """Whether the telegram that was told first of those without an answer is one of the present cycle."""
        ipoc = self._unanswered.popleft()
        return (
            not self._response.ran_away
            and ipoc == self._continuity.newest
            and (self._answered is None or self._answered.ipoc != ipoc)
        )

    # --- telegrams

    def _take(self, telegram: RobotTelegram, at: float) -> None:
        """Place a telegram in the stream, report it, and see whether the robot has taken the answer before."""
        newest = self._continuity.newest
        arrival, sequence, cycles = self._continuity.place(telegram, at, self._total)
        if arrival is Arrival.STRAY:
            self._tell("numbers", f"a telegram of clock {telegram.ipoc} behind {newest} is not heeded")
        if arrival is Arrival.OLD:
            self._report(telegram, at, sequence)
        if arrival in (Arrival.STRAY, Arrival.STRAY_AGAIN, Arrival.OLD):
            return
        if self._axes is not None:
            self._learn(telegram, self._axes)
        if arrival in (Arrival.RESTARTED, Arrival.RESUMED):
            self._begin_session(telegram, arrival is Arrival.RESTARTED)
        else:
            self._settle(telegram, cycles)
        if text := self._response.observe(telegram.offset, self._total, self._began is not None):
            self._tell("correction", text)
        self._report(telegram, at, sequence, _RENUMBERED if arrival is Arrival.RENUMBERED else NO_TROUBLE)

    def _learn(self, telegram: RobotTelegram, channel: AxisChannel) -> None:
        """Note where the axes are and would be."""
        if telegram.planned is not None and telegram.planned_axes is not None:
            channel.learn(Programmed(telegram.planned, telegram.planned_axes))
            if telegram.axes is not None:
                a, b, c, d, e, f = (
                    at - by for at, by in zip(telegram.axes, telegram.planned_axes, strict=True)
                )
                self._axes_offset = a, b, c, d, e, f

    def _report(
        self, telegram: RobotTelegram, at: float, sequence: int, otherwise: Trouble = NO_TROUBLE
    ) -> None:
        trouble = self._response.find_trouble(telegram, self._axes) or otherwise
        self._response.halted = self._response.halted or bool(trouble)
        self._unanswered.append(telegram.ipoc)
        self._events.append(
            ReportReceived(RobotReport(sequence, telegram.pose, at, at, trouble.fact, remedy=trouble.remedy))
        )

    def _begin_session(self, telegram: RobotTelegram, restarted: bool) -> None:
        """Begin a session after the robot's program restarted or was silent: its correction is the reported one."""
        self._answered = None
        self._response.begin_session(restarted)
        offset = telegram.offset or NO_CORRECTION
        turns = (*offset[3:], *(self._axes_offset if self._axes is not None else ()))
        if math.hypot(*offset[:3]) > STANDING_MM or max(map(abs, turns)) > STANDING_DEG:
            self._set(offset, self._axes_offset)
        else:
            self._set(NO_CORRECTION, NO_TURN)
        if self._began is not None:
            self._began = None
            why = (
                "its program has restarted, or moves by itself"
                if restarted
                else f"it sent nothing for {SESSION_MS / 1e3:g} s"
            )
            self._events.append(StreamLost(f"{why}: the correction of before no longer holds"))

    def _settle(self, telegram: RobotTelegram, cycles: int) -> None:
        """See from the count of late answers whether the last one was taken: all cycles between were late then."""
        answered, self._answered = self._answered, None
        if answered is None or answered.late is None or telegram.late is None:
            return
        if telegram.late - answered.late < cycles:
            self._response.missed = 0
            return
        self._response.missed += 1
        self._total = answered.before
        if self._axes is not None:
            self._axes.total = answered.axes_before

    def _set(self, correction: Correction, axes: Joints) -> None:
        """Set the robot's present correction."""
        self._total = correction
        if self._axes is not None:
            self._axes.total = axes
        self._response.reset(correction)

    # --- answers

    def _answer(self, correction: Correction) -> None:
        """Answer the newest telegram."""
        ipoc, before, channel = self._continuity.newest, self._total, self._axes
        assert ipoc is not None
        had, values = before, correction
        if channel is not None:
            had = values = channel.total
            if correction != before:
                values, correction, refusal = channel.follow(before, correction)
                if refusal and not self._limited:
                    self._limited = True
                    self._tell("correction", refusal)
        relative = self._link.mode == "relative"
        if relative:
            values = tuple([to - was for to, was in zip(values, had, strict=True)])
        texts = [fixed(value, DECIMALS) for value in values]
        a, b, c, d, e, f = map(float, texts)
        if relative:
            a, b, c, d, e, f = (was + by for was, by in zip(had, (a, b, c, d, e, f), strict=True))
        if channel is None:
            self._total, axes_before = (a, b, c, d, e, f), NO_TURN
        else:
            axes_before, channel.total = channel.total, (a, b, c, d, e, f)
            self._total = correction
        self._answered = _Answered(ipoc, self._continuity.late, before, axes_before)
        telegram = Telegram(SENSOR, self._link.sentype, dict(zip(self._tags, texts, strict=True)), ipoc)
        self._out.append(encode(telegram))

    def _tell(self, kind: str, text: str) -> None:
        self._events.append(StreamNotice(kind, text))
