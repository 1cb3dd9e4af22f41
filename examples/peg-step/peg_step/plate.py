"""Level plate with a hole, as the centre of a peg's end meets it. The contact model is hil-bridge's own."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from emulators.faults.kinds import Fault
from emulators.seams import Floats, SurfaceFactory
from emulators.surface.contact import Contact
from emulators.surface.faults import SURFACE_FAULTS
from emulators.surface.profile import SurfaceKind as OwnShapes
from emulators.surface.profile import SurfaceProfile
from emulators.surface.shapes import Normal, Shape
from hil_bridge.devices.kinds import SurfaceKind
from protocol.marks import Mark, SettingError, above, setting


@dataclass(frozen=True, slots=True)
class PlateWithHole:
    """Positions that the centre of the peg's end cannot have: below the plate, and not within the clearance."""

    height: float
    """Height of the plate, m."""
    hole: tuple[float, float]
    """Centre of the hole, along and across the path, m."""
    clearance: float
    """Radius of the hole minus radius of the peg, m."""
    deep: float
    """Depth of the hole, m."""

    narrows_below: ClassVar[float] = -math.inf

    def depth_and_normal(self, along: Floats, across: Floats, height: Floats) -> tuple[Floats, Normal]:
        """Return depth and normal for the shortest way out: up out of the plate, or up and sideways into the hole."""
        u, v = along - self.hole[0], across - self.hole[1]
        distance = np.hypot(u, v)
        below, aside, under = (
            self.height - height,
            distance - self.clearance,
            self.height - self.deep - height,
        )
        # from the nearest place in the hole: only aside beside it, only up below it
        inward, up = np.maximum(aside, 0.0), np.maximum(under, 0.0)
        to_hole = np.hypot(inward, up)
        in_hole = (below > 0.0) & (to_hole < below)
        touches = to_hole > 0.0
        length, safe = np.where(touches, to_hole, 1.0), np.where(distance > 0.0, distance, 1.0)
        share = np.where(in_hole & touches, inward / length, 0.0)
        upward = np.where(in_hole & touches, up / length, 1.0)
        free = np.maximum(aside, under)  # in the hole: so far from its wall, or from its ground
        depth = np.where(in_hole, np.where(touches, to_hole, free), below)
        return depth, (-share * u / safe, -share * v / safe, upward)


@dataclass(frozen=True, slots=True)
class PlateProfile(SurfaceProfile):
    """All settings of hil-bridge's own surface with another shape; the settings of its own shapes have no effect."""

    hole_mm: tuple[float, float] = setting(
        (3.0, 2.0), Mark.CHOSEN, "centre of the hole, along and across the path", unit="mm"
    )
    clearance_mm: float = setting(
        0.5, Mark.CHOSEN, "radius of the hole minus radius of the peg", above(0.0), unit="mm"
    )
    hole_depth_mm: float = setting(10.0, Mark.CHOSEN, "depth of the hole", above(0.0), unit="mm")

    def __post_init__(self) -> None:
        SurfaceProfile.__post_init__(self)
        if self.kind is not OwnShapes.FLAT:
            raise SettingError("kind", "must be left out; the shape is a plate with a hole")
        if not all(map(math.isfinite, self.hole_mm)):
            raise SettingError("hole_mm", f"must be two numbers, got {self.hole_mm}")

    def shape(self) -> Shape:
        along, across = self.hole_mm
        return PlateWithHole(
            self.height_mm * 1e-3,
            (along * 1e-3, across * 1e-3),
            self.clearance_mm * 1e-3,
            self.hole_depth_mm * 1e-3,
        )


def make(settings: PlateProfile) -> SurfaceFactory:
    """Return hil-bridge's own surface, with its contact, material, friction and faults, in this shape."""
    return lambda changed: Contact(settings, changed)


FAULTS: dict[str, Fault] = dict(SURFACE_FAULTS)
SURFACE = SurfaceKind("plate-with-hole", "Level plate with a hole for a peg", PlateProfile, make, FAULTS)
