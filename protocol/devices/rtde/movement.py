"""What one movement has come to, as the client of a controller orders it."""

from dataclasses import dataclass


@dataclass(slots=True)
class Movement:
    """The movement that is under way, or the last one."""

    moving: bool = False
    latched: bool = False
    """A fault of this movement: nothing is ordered in it any more."""
    given: bool = False
    """A target was ordered in this movement."""
    settling: int = 0
    """Packages behind a movement in which the arm is let come to its last set point."""

    def begin(self) -> None:
        """Another movement begins."""
        self.moving, self.settling, self.latched, self.given = True, 0, False, False

    def end(self, packages: int) -> bool:
        """End the movement.

        Without a fault, let the arm reach its set point for this many packages; else return False.
        """
        self.moving = False
        if not self.given or self.latched:
            return False
        self.settling = packages
        return True

    def settle(self) -> bool:
        """Whether this package lets the arm come to its set point."""
        if not self.settling:
            return False
        self.settling -= 1
        return True

    def latch(self) -> None:
        """Latch a reported fault."""
        self.latched, self.settling = True, 0

    @property
    def active(self) -> bool:
        """Whether the arm is on its way."""
        return self.moving or self.settling > 0
