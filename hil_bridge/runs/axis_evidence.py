"""Evidence on the force axes that no weight verified: what the moments and the touches of a run tell of them."""

from collections.abc import Collection, Sequence

from hil_bridge.control import Wrist, WristAtOrientation
from hil_bridge.control.course.sideways import HIDDEN_N, Lever, compare_moment
from hil_bridge.control.course.zero import AXES, main_axes
from hil_bridge.runs.pace import face, metres
from hil_bridge.settings.configuration import Config
from protocol.geometry import Quaternion, Vector, Wrench


def lever_of(config: Config) -> Lever | None:
    """Return the vector from the sensor to the tool's end; None if the configuration does not contain it."""
    if config.sensor.url and config.tool.face_mm is None:
        return None
    end, position = face(config), metres(config.sensor.position_mm)
    x, y, z = (a - b for a, b in zip(end.centre, position, strict=True))
    lever = Lever((x, y, z), position, end.radius)
    return lever if lever.length else None


def dead_axis_text(wrist: Wrist, approach: Vector, quaternion: Quaternion, dead: Collection[int]) -> str:
    """Fault of a force axis that carries most of the controlled force, of those that do not change; empty while there
    is none.
    """
    if not dead:
        return ""
    names = " and ".join(AXES[k].lower() for k in main_axes(wrist, approach, quaternion) if k in dead)
    return names and f"{names} of the force sensor did not change since the zero while other axes moved"


class AxisEvidence:
    """The force axes of one run, from the check before it to where the tool was left."""

    def __init__(self, lever: Lever | None) -> None:
        """`lever` leads from the sensor to the tool's end; None where that is not known."""
        self.lever = lever
        self.along: Sequence[int] = ()
        """Numbers of the force axes that nothing has verified, on which the approach lies."""
        self.across: Sequence[int] = ()
        """The same for the directions across the approach."""
        self.tracked = False
        """A touch has been tracked, and so tested where it was in doubt."""
        self._confirmed = self._contradicted = False

    def hidden(self, wrist: WristAtOrientation, wrench: Wrench, force: float) -> float | None:
        """Force across the approach that the moments show and the force axes do not, N; 0 where the tool's end is not
        known, None where these axes are verified. `wrist` has the approach as its first direction, `force` is that
        along it, N.
        """
        if not self.across:
            return None
        if self.lever is None:
            return 0.0
        x, y, z = wrist.directions[0]
        found = compare_moment(self.lever, wrench, (x, y, z), force)
        self._confirmed = self._confirmed or found.confirmed
        self._contradicted = self._contradicted or found.hidden > HIDDEN_N
        return found.hidden

    def hidden_at_rest(self, wrist: WristAtOrientation, measured: Wrench, tolerance_n: float) -> float:
        """Return the same for a stationary tool, from a measured wrench; 0 up to a tolerance."""
        wrench = wrist.contact_wrench(measured)
        hidden = self.hidden(wrist, wrench, wrist.force_along(0, wrench)) or 0.0
        return hidden if hidden > tolerance_n else 0.0

    def unverified(self, aside: bool) -> tuple[str, ...]:
        """Names of the force axes along which something may press on the tool unseen. `aside`: it was left elsewhere
        across the approach than it began.
        """
        axes = set() if self.tracked else set(self.along)
        if aside and (self._contradicted or not self._confirmed):
            axes |= set(self.across)
        return tuple(AXES[k] for k in sorted(axes))
