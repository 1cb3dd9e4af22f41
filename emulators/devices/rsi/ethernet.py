"""The ETHERNET object of a signal flow: it takes one answer a cycle, counts those that are late, and ends at a limit.

There is one decision a cycle: did a valid answer with the clock of this cycle come before the next telegram?
Source: project specification of RSI, section 4.
"""

import re
from collections.abc import Mapping
from typing import NamedTuple

from emulators.devices.rsi.profile import RsiProfile
from emulators.unmodelled import Unmodelled
from protocol.devices.rsi import SENSOR, Telegram, axis_tags, decode, number, pose_tags
from protocol.endpoint import RemoteProtocolError

_DECLARATION = re.compile(rb"\s*<\?xml[^<>]*\?>\s*")
TIMED_OUT = "KSS29002: object ETHERNET1 returns error RSITimeout"
"""Observed."""


class Inputs(NamedTuple):
    """The outcome of a cycle."""

    correction: tuple[float, ...]
    """X Y Z in mm, A B C in degrees."""
    axes: tuple[float, ...]
    """Correction of axes 1 to 6, degrees."""
    stop: bool
    late: bool
    error: str
    """Error that ends RSI; empty without."""


class Ethernet:
    """The object, from one RSI_ON to the next."""

    def __init__(self, profile: RsiProfile, unmodelled: Unmodelled) -> None:
        self._profile, self._unmodelled = profile, unmodelled
        self._tags = channels_of(profile)
        self._zeros = dict.fromkeys(self._tags.values(), 0.0)
        self._channels: dict[str, float] = self._zeros
        """Values of the cycle before, by channel."""
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
            telegram = self.read(raw)
            if telegram.root != SENSOR:
                return f"a {telegram.root} telegram"
            if telegram.type != self._profile.sentype:
                return "another SENTYPE"
            if telegram.ipoc != ipoc:
                return "late" if telegram.ipoc < ipoc else "a clock that was never sent"
            tags = [tag for tag in self._tags if tag in telegram.values]
            # The first name of a channel holds, so that it is written last.
            values = {self._tags[tag]: number(telegram.values[tag]) for tag in reversed(tags)}
        except RemoteProtocolError as error:
            return str(error)
        if self._answer is not None and self._profile.double_reply == "first":
            return "the second in a cycle"
        self._answer = values
        if len(tags) < len(telegram.values):
            for tag in telegram.values:
                if tag not in self._tags:
                    self._unmodelled.touch(f"tag {tag}", "read, and nothing is connected to its channel")
        return ""

    def read(self, raw: bytes) -> Telegram:
        """Read the telegram in an answer.

        A declaration and NUL characters are skipped where the controller accepts them. Raises
        RemoteProtocolError as `decode`.
        """
        if raw.endswith(b"\0"):
            raw = self._cut(
                raw, raw.rstrip(b"\0"), "NUL characters behind an answer", self._profile.answer_nul
            )
        if found := _DECLARATION.match(raw):
            raw = self._cut(raw, raw[found.end() :], "an XML declaration", self._profile.answer_prolog)
        return decode(raw)

    def _cut(self, raw: bytes, rest: bytes, thing: str, choice: str) -> bytes:
        """Return the part of an answer that the controller reads; by `choice` the rest, or a discarded answer."""
        self._unmodelled.touch(thing, "taken, as set" if choice == "take" else "the answer is discarded")
        return rest if choice == "take" else raw

    def close(self) -> Inputs:
        """End a cycle: its channels, and whether the object gives up."""
        answer, self._answer = self._answer, None
        late = answer is None and not self._profile.onlysend
        kept = self._channels if self._profile.keeps else self._zeros
        self._channels = {**kept, **(answer or {})}
        self.late += late
        self._in_a_row = self._in_a_row + 1 if late else 0
        counted = self._in_a_row if self._profile.late_count == "consecutive" else self.late
        *corrections, stop = self._channels.values()
        return Inputs(
            tuple(corrections[:6]),
            tuple(corrections[6:]),
            stop != 0.0,
            late,
            TIMED_OUT if counted > self._profile.timeout else "",
        )


def channels_of(profile: RsiProfile) -> dict[str, str]:
    """Channels of the signal flow by the tags that they take: the pose, the axes, the stop; both names of a channel."""
    pose, axes = pose_tags(profile.correction_tag), axis_tags("axes")
    channels = dict(zip(pose, pose, strict=True))
    for element in profile.axis_tags:
        channels |= zip(axis_tags(element), axes, strict=True)
    return channels | {profile.stop_tag: "stop"}
