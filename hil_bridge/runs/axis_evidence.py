"""Evidence on the force axes that no weight has verified, from the moments and the touches of a run."""

from collections.abc import Collection, Sequence

from hil_bridge.control import Wrist, WristAtOrientation
from hil_bridge.control.course.sideways import HIDDEN_N, Lever, compare_moment
from hil_bridge.control.course.zero import AXES, main_axes
from hil_bridge.runs.pace import face, metres
from hil_bridge.settings.configuration import Config
from protocol.geometry import Quaternion, Vector, Wrench


def lever_of(config: Config) -> Lever | None:
    """Return the vector from the sensor to the end of the tool; None if the configuration does not define it."""
    if config.sensor.url and config.tool.face_mm is None:
        return None
    end, position = face(config), metres(config.sensor.position_mm)
    x, y, z = (a - b for a, b in zip(end.centre, position, strict=True))
    lever = Lever((x, y, z), position, end.radius)
    return lever if lever.length else None


def dead_axis_text(wrist: Wrist, approach: Vector, quaternion: Quaternion, dead: Collection[int]) -> str:
    """Return a description of a dead force axis that carries most of the controlled force; empty if there is none."""
    if not dead:
        return ""
    names = " and ".join(AXES[k].lower() for k in main_axes(wrist, approach, quaternion) if k in dead)
    return names and f"{names} of the force sensor did not change since the zero while other axes moved"


class AxisEvidence:
    """Evidence on the force axes in one run, from the initial check to the final state."""

    def __init__(self, lever: Lever | None) -> None:
        """Create the evidence. `lever` is the vector from the sensor to the end of the tool; None if unknown."""
        self.lever = lever
        self.along: Sequence[int] = ()
        """Indices of the unverified force axes that have a major component of the approach."""
        self.across: Sequence[int] = ()
        """Indices of the unverified force axes that have a major component of the directions across the approach."""
        self.unconfirmable: Sequence[int] = ()
        """Indices of those of `across` on which a force causes no moment, so that nothing can confirm them."""
        self.tracked = False
        """Whether a touch has been tracked, and therefore confirmed if it was in doubt."""
        self._confirmed = self._contradicted = False

    def hidden(self, wrist: WristAtOrientation, wrench: Wrench, force: float) -> float | None:
        """Return the force across the approach that the moments show and the force axes do not, N; 0 if the
        position of the tool's end is unknown; None if the axes across the approach are verified. The first
        direction of `wrist` is the approach. `force` is the force along the approach, N.
        """
        if not self.across:
            return None
        if self.lever is None:
            return 0.0
        x, y, z = wrist.directions[0]
        comparison = compare_moment(self.lever, wrench, (x, y, z), force)
        self._confirmed = self._confirmed or comparison.confirmed
        self._contradicted = self._contradicted or comparison.hidden > HIDDEN_N
        return comparison.hidden

    def hidden_at_rest(self, wrist: WristAtOrientation, measured: Wrench, tolerance_n: float) -> float:
        """Return the hidden force (see `hidden`) on a stationary tool, from a measured wrench, N; 0 within the
        tolerance.
        """
        wrench = wrist.contact_wrench(measured)
        hidden = self.hidden(wrist, wrench, wrist.force_along(0, wrench)) or 0.0
        return hidden if hidden > tolerance_n else 0.0

    def unverified(self, aside: bool) -> tuple[str, ...]:
        """Return the names of the force axes along which a contact of the tool would go unnoticed. `aside` states
        whether the tool's final position across the approach differs from the start.
        """
        axes = set() if self.tracked else set(self.along)
        if aside:
            axes |= set(self.across if self._contradicted or not self._confirmed else self.unconfirmable)
        return tuple(AXES[k] for k in sorted(axes))
