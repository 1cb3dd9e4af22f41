"""The part of a movement that is the same for both kinds of robot: the last order, and whether more may be ordered."""

from protocol.geometry import Pose, Vector


class LastOrder:
    """A movement without its robot."""

    def __init__(self) -> None:
        self._last: Pose | None = None
        self.halted = False
        self.abandoned = False

    @property
    def ordered(self) -> bool:
        """Whether a point has been taken in this movement."""
        return self._last is not None

    @property
    def commanded(self) -> Vector | None:
        """The last point ordered, m; None before the first."""
        return None if self._last is None else self._last.position
