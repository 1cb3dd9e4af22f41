"""The ETHERNET object of a signal flow: it takes one answer a cycle, counts those that are late, and ends at a limit.

There is one decision a cycle: did a valid answer with the clock of this cycle come before the next telegram?
Source: project specification of RSI, section 4.
"""

from collections.abc import Mapping
from typing import NamedTuple

from emulators.devices.rsi.profile import RsiProfile
from emulators.unmodelled import Unmodelled
from protocol.devices.rsi import SENSOR, decode, number, pose_tags
from protocol.endpoint import RemoteProtocolError

TIMED_OUT = "KSS29002: object ETHERNET1 returns error RSITimeout"
"""Observed."""


class Inputs(NamedTuple):
    """The outcome of a cycle."""

    correction: tuple[float, ...]
    """X Y Z in mm, A B C in degrees."""
    stop: bool
    late: bool
    error: str
    """Error that ends RSI; empty without."""


class Ethernet:
    """The object, from one RSI_ON to the next."""

    def __init__(self, profile: RsiProfile, unmodelled: Unmodelled) -> None:
        self._profile, self._unmodelled = profile, unmodelled
        self._tags = (*pose_tags(profile.correction_tag), profile.stop_tag)
        self._channels = dict.fromkeys(self._tags, 0.0)
        """Values of the cycle before."""
        self._answer: Mapping[str, float] | None = None
        """The valid answer of this cycle."""
        self.late = 0
        """Late cycles since RSI_ON, as `<Delay D>` tells them."""
        self._in_a_row = 0

    def take(self, raw: bytes, ipoc: int) -> str:
        """Take an answer in the cycle of this clock, or discard it; why, in words, empty for one that is taken."""
        if self._profile.onlysend:
            return "ONLYSEND: no answers are taken"
        try:
            telegram = decode(raw)
            if telegram.root != SENSOR:
                return f"a {telegram.root} telegram"
            if telegram.type != self._profile.sentype:
                return "another SENTYPE"
            if telegram.ipoc != ipoc:
                return "late" if telegram.ipoc < ipoc else "a clock that was never sent"
            found = {tag: number(telegram.values[tag]) for tag in self._tags if tag in telegram.values}
        except RemoteProtocolError as error:
            return str(error)
        if self._answer is not None and self._profile.double_reply == "first":
            return "the second in a cycle"
        self._answer = found
        if len(found) < len(telegram.values):
            for tag in telegram.values:
                if tag not in found:
                    self._unmodelled.touch(f"tag {tag}", "read, and nothing is connected to its channel")
        return ""

    def close(self) -> Inputs:
        """End a cycle: its channels, and whether the object gives up."""
        answer, self._answer = self._answer, None
        late = answer is None and not self._profile.onlysend
        kept = self._channels if self._profile.keeps else dict.fromkeys(self._tags, 0.0)
        self._channels = {**kept, **(answer or {})}
        self.late += late
        self._in_a_row = self._in_a_row + 1 if late else 0
        counted = self._in_a_row if self._profile.late_count == "consecutive" else self.late
        *correction, stop = (self._channels[tag] for tag in self._tags)
        return Inputs(
            tuple(correction), stop != 0.0, late, TIMED_OUT if counted > self._profile.timeout else ""
        )
