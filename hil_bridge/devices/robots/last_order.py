"""State of a movement, common to all robots: the last order, and whether further orders are allowed."""

from protocol.geometry import Pose, Vector


class LastOrder:
    """Last order of a movement, and whether it was halted."""

    def __init__(self) -> None:
        self._last: Pose | None = None
        self.halted = False
        self.abandoned = False

    @property
    def ordered(self) -> bool:
        """Whether a point has been accepted in this movement."""
        return self._last is not None

    @property
    def commanded(self) -> Vector | None:
        """Last ordered point, m; None before the first order."""
        return None if self._last is None else self._last.position
