"""Parts that the sending and the receiving half of one end share: state, clock, bytes to send, noise account."""

from protocol.devices.s3.adlp.events import NoticeKind
from protocol.devices.s3.adlp.journal import Count, Journal
from protocol.devices.s3.adlp.profile import LinkProfile
from protocol.devices.s3.adlp.transitions import State


class Shared:
    """One end's place in the conversation. Only `Link` changes `state`; the halves return the next one."""

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
        """Longest silence inside a block, s."""
        self._character_time = profile.character_time
        self.journal = Journal()
        self.notice = self.journal.notice
        self.state = State.IDLE
        self.now = 0.0
        """Time of the call that is being served, s."""
        self.deadline: float | None = None
        """When the present state times out, s."""
        self.out = bytearray()
        """Bytes for the line that are not taken yet."""
        self.noise = 0
        """Length of the present run of bytes without meaning."""
        self.unended = False
        """The last message received was taken as ended without its EOT: its last block may be repeated."""

    def arm(self, seconds: float, characters: int = 1) -> None:
        """Time out so long after the characters just handed out have left the line."""
        self.deadline = self.now + characters * self._character_time + seconds

    def is_overdue(self) -> bool:
        """Whether the time-out of this state has passed and was not handled: the owner was held up for longer."""
        return self.deadline is not None and self.now > self.deadline

    def time_of(self, characters: float) -> float:
        """Time of so many characters on the line, s."""
        return characters * self._character_time

    def add_noise(self, size: int) -> None:
        """Put bytes without meaning on the account."""
        self.noise += size
        self.journal.count(Count.NOISE_BYTES, size)

    def end_noise(self) -> None:
        """Tell of the present run of noise and close it."""
        self.notice(NoticeKind.NOISE, f"{self.noise} bytes without meaning dropped")
        self.noise = 0
