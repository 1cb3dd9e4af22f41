"""Reader of a client's answers as orders for a judge, whether or not the controller accepts them."""

import math

from emulators.devices.rsi.arm import CorrectedArm
from emulators.devices.rsi.correction import NOTHING
from emulators.devices.rsi.desk import Desk
from emulators.devices.rsi.ethernet import channels_of
from emulators.devices.rsi.profile import RsiProfile
from emulators.devices.rsi.session import Session
from emulators.orders import Act, Reach, ReceivedOrder
from protocol.devices.rsi import Telegram, number
from protocol.endpoint import RemoteProtocolError


class OrderReader:
    """Reads the corrections that a client commands, accepted or not."""

    def __init__(self, profile: RsiProfile, arm: CorrectedArm, desk: Desk) -> None:
        self._profile, self._kinematics, self._desk = profile, arm.kinematics, desk
        self._channels = channels_of(profile)
        self.begin_session()

    def begin_session(self) -> None:
        """Restart the sum of relative corrections."""
        self._sum = NOTHING * 2

    def read(self, raw: bytes, now: float, session: Session, ipoc: int, acts: bool) -> ReceivedOrder:
        """Return an answer as an order.

        `ipoc` is the clock of the newest telegram. `acts` states whether the robot executes the order.
        """
        try:
            telegram = session.ethernet.read(raw)
            *values, _ = self._values_of(telegram)
        except RemoteProtocolError as error:
            return ReceivedOrder(now, Act.UNREADABLE, str(error), False)
        if telegram.values and self._channels.keys().isdisjoint(telegram.values):
            text = f"tag {next(iter(telegram.values))}, see cell.rsi.correction_tag and axis_tags"
            return ReceivedOrder(now, Act.REFUSED, text, False)
        if self._profile.mode == "relative":
            values = [before + more for before, more in zip(self._sum, values, strict=True)]
            self._sum = tuple(values)
        correction, period = session.correction, self._profile.period
        base, speed, turn = correction.programmed, correction.step_mm * 1e-3, correction.step_rad
        if any(values[6:]):
            a, b, c, d, e, f = (at + by for at, by in zip(session.axes.programmed, values[6:], strict=True))
            base = self._kinematics.pose((a, b, c, d, e, f))
            by_axes = math.radians(sum(session.axes.steps))
            speed, turn = speed + self._kinematics.reach * by_axes, turn + by_axes
        pose = correction.corrected(base, tuple(values[:6]))
        reach = Reach(period, min(speed, self._desk.tool_step_m(period)) / period, turn / period)
        breach = "" if telegram.ipoc == ipoc else "the IPOC is not that of the newest telegram"
        text = f"{self._profile.mode} correction"
        return ReceivedOrder(now, Act.MOTION, text, acts, pose, reach=reach, breach=breach)

    def _values_of(self, telegram: Telegram) -> list[float]:
        """Return the values of the channels in an answer: pose, axes, stop. A missing value is 0."""
        values = dict.fromkeys(self._channels.values(), 0.0)
        for tag in reversed(self._channels):
            if tag in telegram.values:
                values[self._channels[tag]] = number(telegram.values[tag])
        return list(values.values())
