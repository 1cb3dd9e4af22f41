"""Alarms of the emulated controller. Numbers: see the sources in the README; the texts after the numbers are chosen."""

import math
from collections import deque
from collections.abc import Callable

from hil_fanuc.packets import Limit

EMERGENCY = "SRVO-002 Teach pendant E-stop"
EMERGENCY_RMI = "SRVO-289 Motion stopped by an emergency stop"
COMMAND_MISSING = "MOTN-603 Command packet missing"
SEQUENCE = "MOTN-601 ST: Sequence No. error"
NEW_START = "MOTN-607 Start packet without a stop packet"
VERSION_PREFIX = "MOTN-607 ST: Protocol version mismatch"
BRAKE_CONTROL = "MOTN-615 ST:Please Disable Brake Control."
STATUS_CHECK = "SYST-322 Auto status check timeout"
JOINT_LIMITS = {
    Limit.SPEED: "MOTN-609 Velocity limit over",
    Limit.ACCELERATION: "MOTN-610 Acceleration limit over",
    Limit.JERK: "MOTN-611 Jerk limit over",
}
CARTESIAN_LIMITS = {
    Limit.SPEED: "MOTN-720 Cartesian velocity limit over",
    Limit.ACCELERATION: "MOTN-721 Cartesian acceleration limit over",
    Limit.JERK: "MOTN-722 Cartesian jerk limit over",
}
ABNORMAL = "MOTN-625 Abnormal position"
NOT_REACHABLE = "MOTN-018 Position not reachable"
TOO_FAST = "SYST-323 Collaborative speed limit over"
CONTACT = "SYST-321 Contact stop"
SECOND_PEER = "HOST-380 System error 0x30,0x0"
SENSOR_REFUSED = "HOST-380 System error 0x19,0x0"
NONE = "No Error"

BY_ORDER = (
    COMMAND_MISSING, SEQUENCE, NEW_START, VERSION_PREFIX, *JOINT_LIMITS.values(), *CARTESIAN_LIMITS.values(), ABNORMAL,
    NOT_REACHABLE, TOO_FAST, SENSOR_REFUSED,
)  # fmt: skip
"""Alarms that the packets of a client cause."""
_KEPT = 5


class Alarms:
    """Alarms that are active, and the newest ones."""

    def __init__(self, on_alarm: Callable[[str, float], object]) -> None:
        """`on_alarm` is called with the text and the time, s, of each alarm, before it is active."""
        self._on_alarm = on_alarm
        self.active: list[str] = []
        self.newest: deque[str] = deque(maxlen=_KEPT)
        self.raised_at = -math.inf
        """Time of the first alarm that is active, s."""

    def __bool__(self) -> bool:
        return bool(self.active)

    def raise_(self, text: str, now: float) -> None:
        """Raise an alarm. No effect if it is active."""
        if text in self.active:
            return
        self._on_alarm(text, now)
        if not self.active:
            self.raised_at = now
        self.active.append(text)
        self.newest.appendleft(text)

    def reset(self) -> None:
        """Clear all alarms."""
        self.active.clear()
        self.newest.clear()
