"""Record of features of a real device that an emulated device does not model."""

from collections.abc import Sequence
from dataclasses import dataclass

NAMED = 8
"""Maximum number of features that one sentence names. Chosen. Further features are only counted."""


@dataclass(frozen=True, slots=True)
class NotModelled:
    """A feature that a client used and that has no effect, or no ground truth, in the emulated device."""

    device: str
    """Kind of the emulated device."""
    thing: str
    """Name of the feature that the client used, as in the device's manual."""
    detail: str
    """Description of how the emulator handles the feature."""

    def __str__(self) -> str:
        return f"{self.thing} of {self.device} is not modelled: {self.detail}"


def describe_unmodelled(things: Sequence[NotModelled]) -> str:
    """Describe all given features in one sentence; empty if there are none."""
    if not things:
        return ""
    count = len(things)
    count_text = "1 thing that is" if count == 1 else f"{count} things that are"
    named = "; ".join(f"{each.thing} ({each.detail})" for each in things[:NAMED])
    more = f"; and {count - NAMED} more" if count > NAMED else ""
    return f"your client relied on {count_text} not modelled: {named}{more}"
