"""State that the sending and the receiving half of one end share: state, clock, bytes to send, noise counter."""

from protocol.devices.s3.adlp.events import NoticeKind
from protocol.devices.s3.adlp.journal import Count, Journal
from protocol.devices.s3.adlp.profile import LinkProfile
from protocol.devices.s3.adlp.transitions import State


class Shared:
    """Shared state of one end of the link. Only `Link` changes `state`; the halves return the next state."""

    __slots__ = (
        "_character_time",
        "deadline",
        "gap_time",
        "journal",
        "noise",
        "notice",
        "now",
        "out",
        "profile",
        "state",
        "unended",
    )

    def __init__(self, profile: LinkProfile) -> None:
        self.profile = profile
        self.gap_time = profile.gap_time
        """Maximum silence inside a block, s."""
        self._character_time = profile.character_time
        self.journal = Journal()
        self.notice = self.journal.notice
        self.state = State.IDLE
        self.now = 0.0
        """Time of the current call, s."""
        self.deadline: float | None = None
        """Time-out of the current state, s, or None."""
        self.out = bytearray()
        """Bytes to send that have not been taken yet."""
        self.noise = 0
        """Number of bytes in the current run of meaningless bytes."""
        self.unended = False
        """Whether the last message received was considered complete without its EOT. Its last block may then be
        repeated.
        """

    def arm(self, seconds: float, characters: int = 1) -> None:
        """Set the time-out. It starts at the end of transmission of this number of characters, which were just
        returned for sending.
        """
        self.deadline = self.now + characters * self._character_time + seconds

    def is_overdue(self) -> bool:
        """Return whether the time-out of the current state has passed and was not handled, because the owner was
        delayed.
        """
        return self.deadline is not None and self.now > self.deadline

    def time_of(self, characters: float) -> float:
        """Return the transmission time of a number of characters, s."""
        return characters * self._character_time

    def add_noise(self, size: int) -> None:
        """Count meaningless bytes."""
        self.noise += size
        self.journal.count(Count.NOISE_BYTES, size)

    def end_noise(self) -> None:
        """Report the current run of noise and reset its counter."""
        self.notice(NoticeKind.NOISE, f"{self.noise} meaningless bytes dropped")
        self.noise = 0
