"""ETHERNET object of a signal flow: it accepts one answer per cycle, counts late answers, and ends at a limit.

It decides once per cycle whether a valid answer with the clock of this cycle arrived before the next telegram.
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
"""Error text. Observed."""


class Inputs(NamedTuple):
    """Result of a cycle."""

    correction: tuple[float, ...]
    """Correction: X Y Z in mm, A B C in degrees."""
    axes: tuple[float, ...]
    """Correction of axes 1 to 6, degrees."""
    stop: bool
    late: bool
    error: str
    """Error that ends RSI; empty if there is none."""


class Ethernet:
    """State of the ETHERNET object from one RSI_ON to the next."""

    def __init__(self, profile: RsiProfile, unmodelled: Unmodelled) -> None:
        self._profile, self._unmodelled = profile, unmodelled
        self._tags = channels_of(profile)
        self._zeros = dict.fromkeys(self._tags.values(), 0.0)
        self._channels: dict[str, float] = self._zeros
        """Values of the previous cycle, by channel."""
        self._answer: Mapping[str, float] | None = None
        """Valid answer of this cycle."""
        self.late = 0
        """Number of late cycles since RSI_ON, as reported in `<Delay D>`."""
        self._consecutive_late = 0

    def take(self, raw: bytes, ipoc: int) -> str:
        """Accept or discard an answer in the cycle with this clock. Return the reason why it is discarded, or an
        empty string.
        """
        if self._profile.onlysend:
            return "ONLYSEND: no answers are accepted"
        try:
            telegram = self.read(raw)
            if telegram.root != SENSOR:
                return f"a {telegram.root} telegram"
            if telegram.type != self._profile.sentype:
                return "wrong SENTYPE"
            if telegram.ipoc != ipoc:
                return "late" if telegram.ipoc < ipoc else "an IPOC that was never sent"
            tags = [tag for tag in self._tags if tag in telegram.values]
            # The first name of a channel takes precedence, so it is written last.
            values = {self._tags[tag]: number(telegram.values[tag]) for tag in reversed(tags)}
        except RemoteProtocolError as error:
            return str(error)
        if self._answer is not None and self._profile.double_reply == "first":
            return "second answer in a cycle"
        self._answer = values
        if len(tags) < len(telegram.values):
            for tag in telegram.values:
                if tag not in self._tags:
                    self._unmodelled.touch(f"tag {tag}", "read, but its channel is not connected")
        return ""

    def read(self, raw: bytes) -> Telegram:
        """Read the telegram in an answer.

        A declaration and NUL characters are skipped where the controller accepts them. Raises RemoteProtocolError
        like `decode`.
        """
        if raw.endswith(b"\0"):
            raw = self._cut(
                raw, raw.rstrip(b"\0"), "NUL characters after an answer", self._profile.answer_nul
            )
        if declaration := _DECLARATION.match(raw):
            raw = self._cut(raw, raw[declaration.end() :], "an XML declaration", self._profile.answer_prolog)
        return decode(raw)

    def _cut(self, raw: bytes, rest: bytes, thing: str, choice: str) -> bytes:
        """Return the part of an answer that the controller reads: `rest` if `choice` is take, otherwise `raw`."""
        self._unmodelled.touch(
            thing, "accepted, as configured" if choice == "take" else "the answer is discarded"
        )
        return rest if choice == "take" else raw

    def close(self) -> Inputs:
        """End a cycle. Return the values of its channels, and the error if the object has timed out."""
        answer, self._answer = self._answer, None
        late = answer is None and not self._profile.onlysend
        kept = self._channels if self._profile.keeps else self._zeros
        self._channels = {**kept, **(answer or {})}
        self.late += late
        self._consecutive_late = self._consecutive_late + 1 if late else 0
        counted = self._consecutive_late if self._profile.late_count == "consecutive" else self.late
        *corrections, stop = self._channels.values()
        return Inputs(
            tuple(corrections[:6]),
            tuple(corrections[6:]),
            stop != 0.0,
            late,
            TIMED_OUT if counted > self._profile.timeout else "",
        )


def channels_of(profile: RsiProfile) -> dict[str, str]:
    """Return the channel of the signal flow for each tag: pose, axes (under both names), stop."""
    pose, axes = pose_tags(profile.correction_tag), axis_tags("axes")
    channels = dict(zip(pose, pose, strict=True))
    for element in profile.axis_tags:
        channels |= zip(axis_tags(element), axes, strict=True)
    return channels | {profile.stop_tag: "stop"}
