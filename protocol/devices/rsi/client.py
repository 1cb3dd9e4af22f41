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
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple

from protocol.datagram import arrived_at
from protocol.devices.rsi.angles import nearest, pose_of
from protocol.devices.rsi.axis_channel import NO_TURN, AxisChannel, Programmed
from protocol.devices.rsi.elements import axis_tags, pose_tags
from protocol.devices.rsi.profile import RsiLink
from protocol.devices.rsi.telegram import ROBOT, SENSOR, Telegram, decode, encode, fixed, number, numbers
from protocol.endpoint import NO_TROUBLE, RemoteProtocolError, Trouble
from protocol.geometry import Pose, angles_of, from_angles, inverse, product
from protocol.kinematics import Joints
from protocol.numbering import AHEAD_MAX, NewNumbers
from protocol.robot import ReportReceived, RobotReport, StreamEvent, StreamLost, StreamNotice

DECIMALS = 6
"""Observed: decimals of every number that public clients send."""
SESSION_MS = 1000
"""Chosen: a clock that jumps by more, either way, is that of a program that was begun anew."""
PLANNED_MM = 0.1
"""Chosen: a set position that moves by more is that of a program that was begun anew, or that moves by itself."""
PLANNED_DEG = 0.02
"""Chosen: the same of a set axis, where the axes are corrected."""
STANDING_MM = 0.05
"""Chosen: a difference between actual and set position below it is none when a session begins."""
STANDING_DEG = 0.01
"""Chosen: the same of their turn, and of each axis where the axes are corrected."""
FOLLOWS_WITHIN_S = 0.25
"""Chosen: a robot is where its correction was within so long; more than any lag of its servo."""
RUNS_AWAY_CYCLES = 25
"""Chosen: cycles in a row in which a robot leaves a correction that stands; more than any lag of its servo."""
RUNS_AWAY_MM = 0.01
"""Chosen: way of such a cycle; the last digits of a position that stands change by less."""
RUNNING = 3.0
"""Observed (FZI's configuration): status of a program that runs, where it is sent."""
_STATUS = "ProgStatus.R"
_ACTUAL, _SET, _LATE = pose_tags("RIst"), pose_tags("RSol"), "Delay.D"
_ACTUAL_AXES, _SET_AXES = axis_tags("AIPos"), axis_tags("ASPos")
_NOTHING = (0.0,) * 6
_RENUMBERED = Trouble("its clock jumped", "see which program sends to this port")
_NO_POSE = Pose((math.nan,) * 3, (1.0, 0.0, 0.0, 0.0))
"""Stands for a position that is told as something else than numbers: nothing moves with it."""

Correction = tuple[float, ...]
"""X Y Z in mm, A B C in degrees."""


class _Told(NamedTuple):
    """Contents of a telegram of the robot."""

    ipoc: int
    pose: Pose
    planned: Pose | None
    """Set position, without any correction; None where the robot does not tell it."""
    late: int | None
    """Answers that came late or not at all, since the program began; None where it is not told."""
    status: float | None
    axes: Joints | None = None
    """Actual axes, degrees; None where they are not told, or no numbers."""
    planned_axes: Joints | None = None
    """Set axes, without any correction."""
    missing: str = ""
    """Element that a correction of the axes needs and that is not told; empty for none."""

    @property
    def offset(self) -> Correction | None:
        """Actual less set position; None where one of them is not known."""
        return None if self.planned is None or self.pose is _NO_POSE else _offset(self.pose, self.planned)


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
        self._asked: deque[int] = deque()
        """Clocks of the telegrams that were told and not answered yet."""
        self._newest: int | None = None
        """Clock of the newest telegram."""
        self._strays = NewNumbers(link.cycle_ms * 1e-3, link.cycle_ms)
        """Telegrams whose clocks do not follow; they are not answered."""
        self._sequence = 0
        self._heard_at = -math.inf
        self._late: int | None = None
        self._planned: Pose | None = None
        """Set position of the newest telegram that told one."""
        self._planned_axes: Joints | None = None
        """Set axes of the newest telegram that told them."""
        self._offset: Correction | None = None
        """Correction that the newest telegram shows; None where it shows none."""
        self._axes_offset: Joints = NO_TURN
        """The same of the axes, where they are corrected."""
        self._answered: _Answered | None = None
        self._missed = 0
        """Answers in a row that the robot has not taken."""
        self._total: Correction = _NOTHING
        """Correction that the robot has, as far as is known."""
        self._aim: Correction = _NOTHING
        """Correction that the newest set point asked for."""
        self._began: tuple[Pose, Correction] | None = None
        """Pose and correction at which the movement began; None outside of one."""
        self._trail: deque[Correction] = deque(
            [_NOTHING], maxlen=math.ceil(FOLLOWS_WITHIN_S * 1e3 / link.cycle_ms)
        )
        """The newest corrections, cycle by cycle."""
        self._strayed = False
        """The robot has not come along with its correction in this movement."""
        self._halted = False
        """It has reported a fault in this movement: what it lacks of its way is given up."""
        self._leaving, self._apart_mm = 0, 0.0
        """Cycles in a row in which the robot left its correction, which stood; distance from it."""
        self._ran_away = False
        """It goes on and on, as each whole correction is added to the one before: it gets no more answers."""
        self._garbled = self._limited = False
        self._axes: AxisChannel | None = AxisChannel(link) if link.correction == "axes" else None
        self._tags = axis_tags(link.axis_tag) if self._axes else pose_tags(link.correction_tag)

    # --- as an endpoint

    def receive(self, data: Sequence[bytes], now: float) -> None:
        for datagram in data:
            try:
                told = _read(datagram, self._axes is not None)
            except RemoteProtocolError as error:
                if not self._garbled:
                    self._tell("garbled", f"a telegram is not understood: {error}")
                self._garbled = True
                continue
            self._garbled = False
            self._note(told, arrived_at(datagram, now))

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
        if self._strayed and self._offset is not None:
            self._set(self._offset, self._axes_offset)  # as it did not come along, go on from where it is
        self._began, self._aim = (pose, self._total), self._total
        self._limited = self._strayed = self._halted = False

    def end(self) -> None:
        self._began = None

    def target(self, pose: Pose, now: float) -> None:
        if not self._in_time():
            return
        wanted = self._total if self._began is None or self._halted else self._wanted(pose)
        before, self._aim = self._aim, wanted
        self._answer(self._within_reach(wanted, before))

    def hold(self, now: float) -> None:
        if self._in_time():
            self._answer(self._total)

    def _in_time(self) -> bool:
        """Whether the telegram that was told first of those without an answer is one of the present cycle."""
        ipoc = self._asked.popleft()
        return (
            not self._ran_away
            and ipoc == self._newest
            and (self._answered is None or self._answered.ipoc != ipoc)
        )

    # --- telegrams

    def _note(self, told: _Told, at: float) -> None:
        """Number a telegram, tell it, and see whether the robot has taken the answer before."""
        cycles, anew, silent = 1, False, at - self._heard_at > SESSION_MS / 1e3
        renumbered = False
        if self._newest is not None:
            passed, cycle = told.ipoc - self._newest, self._link.cycle_ms
            cycles = round(passed / cycle) or (1 if passed > 0 else 0)
            follows = silent or 0 < passed <= (at - self._heard_at) * 1e3 + AHEAD_MAX * cycle
            first = not self._strays.waits
            if not follows and not self._strays.take(told.ipoc, at):
                if -SESSION_MS <= passed <= 0:
                    self._report(told, at, self._sequence + cycles)  # it was held up, or came again
                elif first:
                    self._tell(
                        "numbers", f"a telegram of clock {told.ipoc} behind {self._newest} is not heeded"
                    )
                return
            self._strays.forget()
            jumped = passed <= 0 or passed > SESSION_MS
            renumbered = jumped and not silent and self._is_corrected(told)
            anew = (jumped and not renumbered) or (passed > 0 and self._is_other_program(told))
            if renumbered:
                cycles = max(1, round((at - self._heard_at) * 1e3 / cycle))
        if self._axes is not None:
            self._learn(told, self._axes)
        if anew or silent:
            self._begin_session(told, anew)
        else:
            self._settle(told, cycles)
        self._sequence += 1 if anew else cycles
        self._newest, self._heard_at, self._late = told.ipoc, at, told.late
        self._planned = told.planned or self._planned
        self._planned_axes = told.planned_axes or self._planned_axes
        self._watch(told)
        self._report(told, at, self._sequence, _RENUMBERED if renumbered else NO_TROUBLE)

    def _learn(self, told: _Told, channel: AxisChannel) -> None:
        """Note where the axes are and would be."""
        if told.planned is not None and told.planned_axes is not None:
            channel.learn(Programmed(told.planned, told.planned_axes))
            if told.axes is not None:
                a, b, c, d, e, f = (at - by for at, by in zip(told.axes, told.planned_axes, strict=True))
                self._axes_offset = a, b, c, d, e, f

    def _is_corrected(self, told: _Told) -> bool:
        """Whether the robot is where its correction brought it, so that only the numbers are others."""
        offset = told.offset
        return (
            offset is not None
            and not self._is_other_program(told)
            and math.dist(offset[:3], self._total[:3]) <= self._link.stray_mm
        )

    def _report(self, told: _Told, at: float, sequence: int, otherwise: Trouble = NO_TROUBLE) -> None:
        trouble = self._find_trouble(told) or otherwise
        self._halted = self._halted or bool(trouble)
        self._asked.append(told.ipoc)
        self._events.append(
            ReportReceived(RobotReport(sequence, told.pose, at, at, trouble.fact, remedy=trouble.remedy))
        )

    def _is_other_program(self, told: _Told) -> bool:
        """Whether the count of late answers begins anew, or the set position is another."""
        if told.late is not None and self._late is not None and told.late < self._late:
            return True
        if told.planned_axes is not None and self._planned_axes is not None:
            turns = zip(told.planned_axes, self._planned_axes, strict=True)
            if any(abs(to - was) > PLANNED_DEG for to, was in turns):
                return True
        if told.planned is None or self._planned is None:
            return False
        return math.dist(told.planned.position, self._planned.position) * 1e3 > PLANNED_MM

    def _begin_session(self, told: _Told, anew: bool) -> None:
        """The robot's program has begun anew, or was silent: its correction is what it tells."""
        self._answered, self._missed = None, 0
        self._leaving, self._ran_away = 0, self._ran_away and not anew
        offset = told.offset or _NOTHING
        turns = (*offset[3:], *(self._axes_offset if self._axes is not None else ()))
        if math.hypot(*offset[:3]) > STANDING_MM or max(map(abs, turns)) > STANDING_DEG:
            self._set(offset, self._axes_offset)
        else:
            self._set(_NOTHING, NO_TURN)
        if self._began is not None:
            self._began = None
            why = (
                "its program has begun anew, or moves by itself"
                if anew
                else f"it sent nothing for {SESSION_MS / 1e3:g} s"
            )
            self._events.append(StreamLost(f"{why}: the correction of before no longer holds"))

    def _settle(self, told: _Told, cycles: int) -> None:
        """See from the count of late answers whether the last one was taken: all cycles between were late then."""
        answered, self._answered = self._answered, None
        if answered is None or answered.late is None or told.late is None:
            return
        if told.late - answered.late < cycles:
            self._missed = 0
            return
        self._missed += 1
        self._total = answered.before
        if self._axes is not None:
            self._axes.total = answered.axes_before

    def _watch(self, told: _Told) -> None:
        """See whether the robot has come along with its correction."""
        stands = self._trail[-1] == self._total
        self._trail.append(self._total)
        self._offset = told.offset
        if self._link.mode == "absolute" and self._offset is not None:
            self._watch_flight(self._offset, stands)
        if self._offset is None or self._began is None or self._missed or self._strayed:
            return
        place, most = self._offset[:3], self._link.stray_mm
        for total in reversed(self._trail):
            if math.dist(place, total[:3]) <= most:
                return  # nearly always one of the newest
        stray = min(math.dist(place, total[:3]) for total in self._trail)
        if stray > most:
            self._strayed = True
            self._tell(
                "correction",
                f"the robot is {stray:.1f} mm beside its correction: it stands, or POSCORR or AXISCORR limits it, or "
                "HOLDON or the mode of RSI_ON are not as set",
            )

    def _watch_flight(self, offset: Correction, stands: bool) -> None:
        """See whether the robot leaves a correction that stands: a controller in relative mode adds up whole ones."""
        before, self._apart_mm = self._apart_mm, math.dist(offset[:3], self._total[:3])
        leaves = stands and self._apart_mm > before + RUNS_AWAY_MM
        self._leaving = self._leaving + 1 if leaves else 0
        if self._leaving >= RUNS_AWAY_CYCLES and self._apart_mm > self._link.stray_mm:
            self._ran_away = True

    def _set(self, correction: Correction, axes: Joints) -> None:
        """This is the robot's correction now."""
        self._total = correction
        if self._axes is not None:
            self._axes.total = axes
        self._trail.clear()
        self._trail.append(correction)

    def _find_trouble(self, told: _Told) -> Trouble:
        if told.status is not None and told.status != RUNNING:
            return Trouble(
                f"its program does not run (ProgStatus {told.status:g})",
                "release its stops and start it again",
            )
        if self._ran_away:
            return Trouble(
                "it runs away from a correction that stands, and gets no more answers",
                "give robot.rsi.mode what its program gives to RSI_ON, then start it again",
            )
        if told.missing:
            return Trouble(
                f"its telegrams have no {told.missing}, which a correction of the axes needs",
                f"enter DEF_{told.missing} into the controller's Ethernet configuration",
            )
        if self._axes is not None and told.pose is not _NO_POSE:
            if told.axes is None or told.planned_axes is None:
                return Trouble("its axes are told as no numbers", "look at its Ethernet configuration")
            beside_mm = self._axes.beside_mm(told.pose, told.axes)
            if not beside_mm <= self._link.stray_mm:
                return Trouble(
                    f"its axes stand {beside_mm:.1f} mm beside its pose, by the sizes of a {self._link.model}",
                    "give robot.rsi.model the arm, and let the program set $BASE to $ROBROOT",
                )
        if self._missed >= self._link.late_max:
            return Trouble(
                f"it has not taken {self._missed} answers in a row (late so far: {told.late})",
                "look at the network, at this computer's load, and at SENTYPE",
            )
        return NO_TROUBLE

    # --- corrections

    def _wanted(self, pose: Pose) -> Correction:
        """The correction that brings the robot to this pose."""
        assert self._began is not None
        (position, quaternion), total = self._began
        (x, y, z), (u, v, w) = pose.position, position
        x0, y0, z0, a0, b0, c0 = total
        turn = product(product(pose.quaternion, inverse(quaternion)), from_angles(a0, b0, c0))
        (a, b, c), (_, _, _, a0, b0, c0) = angles_of(turn), self._total
        x, y, z = x0 + (x - u) * 1e3, y0 + (y - v) * 1e3, z0 + (z - w) * 1e3
        return x, y, z, nearest(a, a0), nearest(b, b0), nearest(c, c0)

    def _within_reach(self, wanted: Correction, before: Correction) -> Correction:
        """As much of the way there as limits and one cycle allow: what the set point has moved since it asked for
        `before`, and a little of what the robot is behind.
        """
        link = self._link
        most, most_deg = link.limit_mm, link.limit_deg
        bounded = (
            *[max(-most, min(most, value)) for value in wanted[:3]],
            *[max(-most_deg, min(most_deg, value)) for value in wanted[3:]],
        )
        if not self._limited and math.dist(bounded, wanted) > 1e-9:
            self._limited = True
            self._tell(
                "correction",
                f"the correction stays within {link.limit_mm:g} mm and {link.limit_deg:g}° of the robot's program; "
                "begin nearer, or raise limit_mm, limit_deg and POSCORR's limits",
            )
        x, y, z, a, b, c = [there - here for there, here in zip(bounded, self._total, strict=True)]
        u, v, w, d, e, f = [there - here for there, here in zip(wanted, before, strict=True)]
        cycle = link.cycle_ms / 1e3
        most_mm = min(link.fastest_mm_s * cycle, math.hypot(u, v, w) + link.catch_up_mm_s * cycle)
        most_deg = min(link.fastest_deg_s * cycle, math.hypot(d, e, f) + link.catch_up_deg_s * cycle)
        share = min(
            1.0, most_mm / max(math.hypot(x, y, z), 1e-12), most_deg / max(math.hypot(a, b, c), 1e-12)
        )
        i, j, k, p, q, r = self._total
        return i + share * x, j + share * y, k + share * z, p + share * a, q + share * b, r + share * c

    def _answer(self, correction: Correction) -> None:
        """Answer the newest telegram."""
        assert self._newest is not None
        ipoc, before, channel = self._newest, self._total, self._axes
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
        self._answered = _Answered(ipoc, self._late, before, axes_before)
        telegram = Telegram(SENSOR, self._link.sentype, dict(zip(self._tags, texts, strict=True)), ipoc)
        self._out.append(encode(telegram))

    def _tell(self, kind: str, text: str) -> None:
        self._events.append(StreamNotice(kind, text))


def _read(raw: bytes, needs_axes: bool) -> _Told:
    """The contents of a telegram of the robot; a position that is no number is told as one that is none.

    Raises RemoteProtocolError for one without a position or a clock.
    """
    telegram = decode(raw)
    values = telegram.values
    if telegram.root != ROBOT:
        raise RemoteProtocolError(f"it is a {telegram.root} telegram, not one of a robot")
    if not all(map(values.__contains__, _ACTUAL)):
        raise RemoteProtocolError(
            "it has no RIst; enter DEF_RIst into the controller's Ethernet configuration"
        )
    pose, planned = _pose(values, _ACTUAL), _pose(values, _SET)
    late = number(values[_LATE]) if _LATE in values else None
    status = number(values[_STATUS]) if _STATUS in values else None
    axes, planned_axes = (_axes(values, tags) if needs_axes else None for tags in (_ACTUAL_AXES, _SET_AXES))
    needed = {"RSol": _SET, "AIPos": _ACTUAL_AXES, "ASPos": _SET_AXES} if needs_axes else {}
    missing = next((name for name, tags in needed.items() if tags[0] not in values), "")
    late_count = None if late is None else int(late)
    return _Told(telegram.ipoc, pose or _NO_POSE, planned, late_count, status, axes, planned_axes, missing)


def _axes(values: Mapping[str, str], tags: tuple[str, ...]) -> Joints | None:
    """The axes in these values, degrees; None where one is no number."""
    try:
        found = numbers(values, tags)
    except RemoteProtocolError:
        return None
    if found is None:
        return None
    a, b, c, d, e, f = found
    return a, b, c, d, e, f


def _pose(values: Mapping[str, str], tags: tuple[str, ...]) -> Pose | None:
    """The pose in these values; None where one is missing or no number."""
    texts = tuple([values.get(tag) for tag in tags])
    return None if None in texts else _pose_in(texts)


@lru_cache(maxsize=4)
def _pose_in(texts: tuple[str, ...]) -> Pose | None:
    """The pose in X Y Z A B C; None where one is no number. A set position stays the same for long."""
    try:
        return pose_of([*map(number, texts)])
    except RemoteProtocolError:
        return None


def _offset(actual: Pose, planned: Pose) -> Correction:
    """The correction between two poses."""
    x, y, z = ((there - here) * 1e3 for there, here in zip(actual.position, planned.position, strict=True))
    return (x, y, z, *angles_of(product(actual.quaternion, inverse(planned.quaternion))))
