"""Evidence of an emulated robot about a client: its orders, and the way of the tool. Its size is bounded."""

import math
from dataclasses import dataclass, field

from emulators.orders import Act, HeardOrder, Hindrance
from hil_bridge.lab.conform.scenarios import MOVED_M, SAME_PLACE_M
from protocol.geometry import Vector


@dataclass(slots=True)
class Seen:
    """Evidence of one scenario. Times are seconds since its begin; lengths m, speeds m/s."""

    contact_at: float | None = None
    """First sign of the client: a connection, a question or an order."""
    unreadable: int = 0
    """Packages that the robot can make nothing of."""
    first_unreadable: str = ""
    orders: int = 0
    """Orders of motion."""
    taken: int = 0
    """Those that the robot could act on."""
    first_order_at: float | None = None
    last_order_at: float | None = None
    largest_step_m: float = 0.0
    """Largest distance of the places of two orders in a row."""
    leaps: int = 0
    """Orders farther from the one before than the robot goes in one cycle."""
    longest_pause_s: float = 0.0
    """Longest time between two orders."""
    moved_at: float | None = None
    moved_m: float = 0.0
    """Farthest that the tool was from its start."""
    fastest_m_s: float = 0.0
    """Largest speed of the tool, looked at every few milliseconds."""
    fault_at: float | None = None
    """The fault of the scenario; without one where the robot may not move from the start, its first order."""
    last_motion_s: float | None = None
    """From the fault to the last order that would have moved the tool."""
    after_stop: int = 0
    """Orders that would have moved the tool, later than `react_s` behind the fault."""
    after_stop_step_m: float = 0.0
    """The largest step of those."""
    moved_after_m: float = 0.0
    """How far the tool went later than `react_s` behind the fault."""
    releases: list[str] = field(default_factory=list)
    """Acts behind the fault that belong to a person at the robot, the first ten."""
    returned_at: float | None = None
    """End of the cut."""
    back_at: float | None = None
    """First order behind the cut that the robot could act on."""
    hindrance: str = ""
    """First state behind the first order in which the robot did not move by orders."""
    hindered_at: float | None = None
    own_stop: str = ""
    """The first such state that an order of the client brought about."""
    ended_at: float | None = None
    exit_code: int | None = None
    """As the shell's; minus the number of a signal. None where the client was killed."""
    told_to_end: bool = False
    killed: bool = False
    left_m_s: float = 0.0
    """Speed of the tool at the end."""
    last_pose: tuple[Vector, tuple[float, ...]] | None = None
    """Position, m, and quaternion w x y z of the tool at the end."""


class Watch:
    """Listens to a robot, and looks at its tool."""

    def __init__(self, begun_at: float, react_s: float, *, stops: bool, from_start: bool) -> None:
        """`stops`: the fault stops the robot. `from_start`: it may not move from the start on."""
        self.seen = Seen()
        self._begun_at, self._react = begun_at, react_s
        self._stops, self._from_start = stops, from_start
        self._start: Vector | None = None
        """Where the tool was first."""
        self._place: Vector | None = None
        """Where it is."""
        self._last: Vector | None = None
        """Place of the newest order."""
        self._stood_at: Vector | None = None
        """Where the tool was at `react_s` behind the fault."""
        self._hindered = False

    # --- orders

    def hear(self, order: HeardOrder) -> None:
        """An order came to the robot."""
        at, seen = order.at - self._begun_at, self.seen
        if seen.contact_at is None:
            seen.contact_at = at
        match order.act:
            case Act.UNREADABLE:
                seen.unreadable += 1
                seen.first_unreadable = seen.first_unreadable or order.words
            case Act.RELEASE:
                behind = self._from_start or (seen.fault_at is not None and at > seen.fault_at)
                if behind and len(seen.releases) < 10:
                    seen.releases.append(order.words)
            case Act.PROGRAM if order.moves:
                self._ordered(at, order, True, 0.0)
            case Act.MOTION:
                self._motion(at, order)
            case _:
                pass

    def _motion(self, at: float, order: HeardOrder) -> None:
        step, moving = 0.0, order.moves
        if (place := order.position) is not None and all(map(math.isfinite, place)):
            before = self._last if self._last is not None else self._place
            far = math.dist(place, before) if before is not None else math.inf
            moving = far > SAME_PLACE_M
            if self._last is not None:
                step = far
            self._last = place
        self._ordered(at, order, moving, step)

    def _ordered(self, at: float, order: HeardOrder, moving: bool, step: float) -> None:
        seen = self.seen
        seen.orders += 1
        seen.taken += order.taken
        if seen.last_order_at is not None:
            seen.longest_pause_s = max(seen.longest_pause_s, at - seen.last_order_at)
        seen.last_order_at = at
        seen.largest_step_m = max(seen.largest_step_m, step)
        seen.leaps += step > order.reach_m + SAME_PLACE_M
        if seen.first_order_at is None:
            seen.first_order_at = at
        if self._from_start and moving and seen.fault_at is None:
            seen.fault_at = at
        if self._stops and seen.fault_at is not None and moving and at >= seen.fault_at:
            since = at - seen.fault_at
            seen.last_motion_s = since
            if since > self._react and not (self._from_start and order.taken):
                seen.after_stop += 1
                seen.after_stop_step_m = max(seen.after_stop_step_m, step)
        if order.taken and seen.returned_at is not None and seen.back_at is None and at >= seen.returned_at:
            seen.back_at = at

    # --- the robot

    def look(self, now: float, position: Vector, speed: float, hindrance: Hindrance | None) -> None:
        """The tool is there, m and m/s, and this keeps it from moving."""
        at, seen = now - self._begun_at, self.seen
        if self._start is None:
            self._start = position
        self._place = position
        seen.fastest_m_s = max(seen.fastest_m_s, speed)
        away = math.dist(position, self._start)
        seen.moved_m = max(seen.moved_m, away)
        if seen.moved_at is None and away >= MOVED_M:
            seen.moved_at = at
        if self._stops and seen.fault_at is not None and at >= seen.fault_at + self._react:
            if self._stood_at is None:
                self._stood_at = position
            seen.moved_after_m = max(seen.moved_after_m, math.dist(position, self._stood_at))
        self._hinder(at, hindrance)

    def _hinder(self, at: float, hindrance: Hindrance | None) -> None:
        seen, before = self.seen, self._hindered
        self._hindered = hindrance is not None
        if hindrance is None or before or seen.first_order_at is None:
            return
        leaving = seen.told_to_end or seen.ended_at is not None
        if not seen.hindrance and (
            hindrance.by_order or not leaving
        ):  # a robot may stop when its client has gone
            seen.hindrance, seen.hindered_at = hindrance.words, at
        if hindrance.by_order and not seen.own_stop:
            seen.own_stop = hindrance.words
