"""Level plate on springs: the shortest surface that a tool can press on."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from emulators.faults import Handler
from emulators.seams import Floats, Surface, SurfaceFactory
from hil_bridge.devices.kinds import SurfaceKind
from protocol.marks import Mark, above, check_settings, setting


@dataclass(frozen=True, slots=True)
class SpringProfile:
    """Settings of a level plate on springs."""

    height_mm: float = setting(590.0, Mark.CHOSEN, "height of the plate", unit="mm")
    stiffness_n_mm: float = setting(5.0, Mark.CHOSEN, "stiffness of the springs", above(0.0), unit="N/mm")

    def __post_init__(self) -> None:
        check_settings(self)


class Spring:
    """Plate on springs: a contact model without memory."""

    remembered_until = None

    def __init__(self, profile: SpringProfile, changed: Callable[[float], object]) -> None:
        self._height, self._stiffness = profile.height_mm * 1e-3, profile.stiffness_n_mm * 1e3
        self.handlers: Mapping[str, Handler] = {}

    def force(self, positions: Floats, velocities: Floats, times: Floats) -> Floats:
        force = np.zeros_like(positions)
        force[:, 2] = self._stiffness * np.maximum(self._height - positions[:, 2], 0.0)
        return force

    def aside(self) -> Surface:
        return self

    def rewind(self, time: float) -> None:
        """Do nothing: there is no memory."""


def make_spring(settings: SpringProfile) -> SurfaceFactory:
    return lambda changed: Spring(settings, changed)


SURFACE = SurfaceKind("toyspring", "Level plate on springs", SpringProfile, make_spring)
