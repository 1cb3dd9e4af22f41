"""State of one movement that the client of a controller has ordered."""

from dataclasses import dataclass


@dataclass(slots=True)
class Movement:
    """State of the current or the last movement."""

    moving: bool = False
    latched: bool = False
    """Whether a fault occurred in this movement. No further orders are then given in it."""
    given: bool = False
    """Whether a target was ordered in this movement."""
    settling: int = 0
    """Number of packages for which the arm may still approach its last set point after a movement."""

    def begin(self) -> None:
        """Begin a new movement."""
        self.moving, self.settling, self.latched, self.given = True, 0, False, False

    def end(self, packages: int) -> bool:
        """End the movement. Return whether the arm may continue to its set point, for `packages` packages.

        It may not after a fault, or if no target was ordered.
        """
        self.moving = False
        if not self.given or self.latched:
            return False
        self.settling = packages
        return True

    def settle(self) -> bool:
        """Count down one package after the movement. Return whether the arm may still approach its set point."""
        if not self.settling:
            return False
        self.settling -= 1
        return True

    def latch(self) -> None:
        """Latch a fault: end all orders of this movement."""
        self.latched, self.settling = True, 0

    @property
    def active(self) -> bool:
        """Whether the arm is moving, or approaching its last set point after a movement."""
        return self.moving or self.settling > 0
