"""RSI client: answers each telegram of the robot once, with the correction for the newest set point.

A correction is the offset from the robot's uncorrected pose, in the base frame: X Y Z in mm, and angles A B C in
degrees whose rotation is applied after the robot's own rotation, R = R(A B C)·R₀. In absolute mode, an answer
carries the entire correction. In relative mode, it carries the change since the last answer that the robot
accepted.

The robot's count of late answers shows which answers it has accepted. After a lost answer, the next answers
compensate for the loss gradually, so that the set point and the robot stay together. A repeated telegram, or one
that arrives after a later one, gets no answer: its cycle is over, and an increment must not be applied twice.

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
"""Number of decimals in an answer. Observed: public clients send this number."""
STANDING_MM = 0.05
"""Largest difference between actual and set position that counts as zero when a session starts, mm. Chosen."""
STANDING_DEG = 0.01
"""Largest difference between actual and set rotation that counts as zero when a session starts, degrees. Chosen. If
the axes are corrected, it also applies to each axis.
"""
_RENUMBERED = Trouble("its clock jumped", "check which program sends to this port")


class _LastAnswer(NamedTuple):
    """The last answer sent."""

    ipoc: int
    late: int | None
    before: Correction
    """Current correction of the robot if it did not accept this answer."""
    axes_before: Joints
    """Current correction of the axes if the robot did not accept this answer and the axes are corrected."""


class RsiClient:
    """`StreamClient` for a controller that sends first."""

    def __init__(self, link: RsiLink) -> None:
        self._link = link
        self._events: deque[StreamEvent] = deque()
        self._out: list[bytes] = []
        self._unanswered: deque[int] = deque()
        """Clocks (IPOC) of the telegrams that were reported and have not been answered yet."""
        self._continuity, self._response = Continuity(link), Response(link)
        self._axes_offset: Joints = NO_TURN
        """Difference between actual and set axes in the newest telegram, degrees, if the axes are corrected."""
        self._last_answer: _LastAnswer | None = None
        self._total: Correction = NO_CORRECTION
        """Current correction of the robot, as far as it is known."""
        self._target: Correction = NO_CORRECTION
        """Correction for the newest set point."""
        self._start: tuple[Pose, Correction] | None = None
        """Pose and correction at which the movement began; None outside a movement."""
        self._garbled = self._limited = False
        self._axes: AxisChannel | None = AxisChannel(link) if link.correction == "axes" else None
        self._tags = axis_tags(link.axis_tag) if self._axes else pose_tags(link.correction_tag)

    # --- Endpoint

    def receive(self, data: Sequence[bytes], now: float) -> None:
        for datagram in data:
            try:
                telegram = read_telegram(datagram, self._axes is not None)
            except RemoteProtocolError as error:
                if not self._garbled:
                    self._notice("garbled", f"invalid telegram: {error}")
                self._garbled = True
                continue
            self._garbled = False
            self._process_telegram(telegram, arrived_at(datagram, now))

    def next_event(self) -> StreamEvent | None:
        return self._events.popleft() if self._events else None

    def data_to_send(self, now: float) -> Sequence[bytes]:
        out, self._out = self._out, []
        return out

    def next_deadline(self) -> float | None:
        return None

    def handle_deadline(self, now: float) -> None:
        """Do nothing: this client has no deadline, because the robot drives the cycle."""

    # --- movements

    def begin(self, pose: Pose) -> None:
        offset = self._response.offset
        if self._response.strayed and offset is not None:
            self._set(
                offset, self._axes_offset
            )  # the robot did not follow: continue from its actual position
        self._start, self._target = (pose, self._total), self._total
        self._limited = False
        self._response.begin_movement()

    def end(self) -> None:
        self._start = None

    def target(self, pose: Pose, now: float) -> None:
        if not self._is_in_time():
            return
        total, before = self._total, self._target
        self._target = total
        if self._start is not None and not self._response.halted:
            self._target = correction_for(pose, self._start, total)
        bounded = clamp(self._target, self._link)
        if not self._limited and math.dist(bounded, self._target) > 1e-9:
            self._limited = True
            self._notice(
                "correction",
                f"the correction stays within {self._link.limit_mm:g} mm and {self._link.limit_deg:g}° of the robot's "
                "program; begin nearer, or raise limit_mm, limit_deg and POSCORR's limits",
            )
        change = tuple([to - was for to, was in zip(self._target, before, strict=True)])
        self._answer(step_towards(bounded, total, change, self._link))

    def hold(self, now: float) -> None:
        if self._is_in_time():
            self._answer(self._total)

    def _is_in_time(self) -> bool:
        """Return whether the oldest unanswered telegram belongs to the current cycle and may be answered."""
        ipoc = self._unanswered.popleft()
        return (
            not self._response.has_run_away
            and ipoc == self._continuity.newest
            and (self._last_answer is None or self._last_answer.ipoc != ipoc)
        )

    # --- telegrams

    def _process_telegram(self, telegram: RobotTelegram, at: float) -> None:
        """Classify a telegram, report it, and determine whether the robot accepted the previous answer."""
        newest = self._continuity.newest
        arrival, sequence, cycles = self._continuity.place(telegram, at, self._total)
        if arrival is Arrival.STRAY:
            self._notice("numbers", f"a telegram of clock {telegram.ipoc} after {newest} is ignored")
        if arrival is Arrival.OLD:
            self._report(telegram, at, sequence)
        if arrival in (Arrival.STRAY, Arrival.STRAY_AGAIN, Arrival.OLD):
            return
        if self._axes is not None:
            self._store_axes(telegram, self._axes)
        if arrival in (Arrival.RESTARTED, Arrival.RESUMED):
            self._begin_session(telegram, arrival is Arrival.RESTARTED)
        else:
            self._check_accepted(telegram, cycles)
        if text := self._response.observe(telegram.offset, self._total, self._start is not None):
            self._notice("correction", text)
        self._report(telegram, at, sequence, _RENUMBERED if arrival is Arrival.RENUMBERED else NO_TROUBLE)

    def _store_axes(self, telegram: RobotTelegram, channel: AxisChannel) -> None:
        """Store the actual axes and the axes set by the program."""
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
        """Begin a session after the robot's program restarted or was silent. The reported correction becomes the
        current one.
        """
        self._last_answer = None
        self._response.begin_session(restarted)
        offset = telegram.offset or NO_CORRECTION
        turns = (*offset[3:], *(self._axes_offset if self._axes is not None else ()))
        if math.hypot(*offset[:3]) > STANDING_MM or max(map(abs, turns)) > STANDING_DEG:
            self._set(offset, self._axes_offset)
        else:
            self._set(NO_CORRECTION, NO_TURN)
        if self._start is not None:
            self._start = None
            why = (
                "its program restarted, or moves by itself"
                if restarted
                else f"it sent nothing for {SESSION_MS / 1e3:g} s"
            )
            self._events.append(StreamLost(f"{why}: the previous correction is no longer valid"))

    def _check_accepted(self, telegram: RobotTelegram, cycles: int) -> None:
        """Determine from the count of late answers whether the robot accepted the last answer. If it did not, all
        cycles since that answer count as late.
        """
        answered, self._last_answer = self._last_answer, None
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
        """Set the current correction of the robot and of its axes."""
        self._total = correction
        if self._axes is not None:
            self._axes.total = axes
        self._response.reset(correction)

    # --- answers

    def _answer(self, correction: Correction) -> None:
        """Answer the newest telegram with a step to this correction."""
        ipoc, before, channel = self._continuity.newest, self._total, self._axes
        assert ipoc is not None
        had, values = before, correction
        if channel is not None:
            had = values = channel.total
            if correction != before:
                values, correction, refusal = channel.follow(before, correction)
                if refusal and not self._limited:
                    self._limited = True
                    self._notice("correction", refusal)
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
        self._last_answer = _LastAnswer(ipoc, self._continuity.late, before, axes_before)
        telegram = Telegram(SENSOR, self._link.sentype, dict(zip(self._tags, texts, strict=True)), ipoc)
        self._out.append(encode(telegram))

    def _notice(self, kind: str, text: str) -> None:
        self._events.append(StreamNotice(kind, text))
