"""Settings of a surface: shape, position, material, friction, and a wall across the path.

Source of the default stiffness: project specification of the force control, section 5.
"""

import math
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import pairwise
from typing import Any, ClassVar

from emulators.surface.height_map import read_height_map
from emulators.surface.materials import MaterialProfile
from emulators.surface.removal import RemovalProfile
from emulators.surface.shapes import (
    CircularArc,
    HeightMap,
    Plane,
    Shape,
    Sinusoidal,
    SinusoidalBoth,
    Sphere,
)
from protocol.marks import Mark, SettingError, above, at_least, between, check_settings, setting


class SurfaceKind(StrEnum):
    """Shape of the surface."""

    FLAT = "flat"
    SLOPED = "sloped"
    SINUSOIDAL = "sinusoidal"
    SINUSOIDAL_BOTH = "sinusoidal_both"
    CIRCULAR_ARC = "circular_arc"
    SPHERE = "sphere"
    HEIGHT_MAP = "height_map"


@dataclass(frozen=True, slots=True)
class SurfaceProfile:
    """Shape, position and material of the surface."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    kind: SurfaceKind = setting(SurfaceKind.FLAT, Mark.CHOSEN, "shape of the surface")
    origin_x_mm: float = setting(900.0, Mark.CHOSEN, "base x of path coordinate 0", unit="mm")
    origin_y_mm: float = setting(0.0, Mark.CHOSEN, "base y of path coordinate 0", unit="mm")
    path_deg: float = setting(
        90.0, Mark.CHOSEN, "direction of the path in the base x-y plane, 0 along x, 90 along y", unit="°"
    )
    height_mm: float = setting(590.0, Mark.CHOSEN, "base z of the surface at path coordinate 0", unit="mm")
    slope_deg: float = setting(
        5.0, Mark.CHOSEN, "rise along the path (sloped)", between(-80.0, 80.0), unit="°"
    )
    amplitude_mm: float = setting(
        5.0, Mark.CHOSEN, "amplitude of the waves (sinusoidal, sinusoidal_both)", at_least(0.0), unit="mm"
    )
    period_mm: float = setting(
        100.0,
        Mark.CHOSEN,
        "period of the waves along the path (sinusoidal, sinusoidal_both)",
        above(0.0),
        unit="mm",
    )
    period_across_mm: float = setting(
        100.0, Mark.CHOSEN, "period of the waves across the path (sinusoidal_both)", above(0.0), unit="mm"
    )
    radius_mm: float = setting(300.0, Mark.CHOSEN, "radius (circular_arc, sphere)", above(0.0), unit="mm")
    height_map_file: str = setting(
        "",
        Mark.CHOSEN,
        "text file of heights above height_mm, mm; each line is a row of the grid, rows along the path (height_map)",
    )
    height_map_spacing_mm: float = setting(
        5.0, Mark.CHOSEN, "spacing of that grid (height_map)", above(0.0), unit="mm"
    )
    stiffness_n_m: float = setting(
        5000.0,
        Mark.OBSERVED,
        "stiffness along the normal; the default is the paper's sponge",
        at_least(0.0),
        unit="N/m",
    )
    damping_ns_m: float = setting(
        10.0,
        Mark.ASSUMED,
        "damping along the normal while in contact (material linear)",
        at_least(0.0),
        unit="N·s/m",
    )
    material: MaterialProfile = field(default_factory=MaterialProfile)
    stiffness_profile: tuple[tuple[float, float], ...] = setting(
        (),
        Mark.CHOSEN,
        "factors on the stiffness along the path, as pairs of path coordinate in mm and factor; "
        "linear in between, constant beyond; empty: 1 everywhere",
    )
    begin_mm: float | None = setting(
        None, Mark.CHOSEN, "path coordinate at which the surface begins; by default unlimited", unit="mm"
    )
    end_mm: float | None = setting(
        None, Mark.CHOSEN, "path coordinate beyond which there is no surface; none by default", unit="mm"
    )
    wall_at_mm: float | None = setting(
        None,
        Mark.CHOSEN,
        "path coordinate of an upright face, beyond which the surface is higher; none by default",
        unit="mm",
    )
    wall_height_mm: float = setting(
        1000.0,
        Mark.CHOSEN,
        "height of that face: a few mm for a step, more than the tool can climb for a wall",
        above(0.0),
        unit="mm",
    )
    wall_stiffness_n_m: float = setting(
        50000.0, Mark.CHOSEN, "stiffness of the vertical face", at_least(0.0), unit="N/m"
    )
    friction: float = setting(0.2, Mark.ASSUMED, "Coulomb coefficient of tangential friction", at_least(0.0))
    friction_smoothing_mm_s: float = setting(
        1.0,
        Mark.CHOSEN,
        "tangential speed at which friction reaches 71 % of its full value",
        above(0.0),
        unit="mm/s",
    )

    removal: RemovalProfile = field(default_factory=RemovalProfile)

    def __post_init__(self) -> None:
        check_settings(self)
        if any(len(pair) != 2 for pair in self.stiffness_profile):
            raise SettingError("stiffness_profile", "must be pairs of path coordinate and factor")
        if not all(math.isfinite(number) for pair in self.stiffness_profile for number in pair):
            raise SettingError("stiffness_profile", "must be finite numbers")
        if any(factor < 0.0 for _, factor in self.stiffness_profile):
            raise SettingError("stiffness_profile", "must have factors of at least 0")
        for (coordinate, _), (following, _) in pairwise(self.stiffness_profile):
            if not coordinate < following:
                raise SettingError(
                    "stiffness_profile", f"must ascend, but {following:g} mm follows {coordinate:g} mm"
                )
        if self.begin_mm is not None and self.end_mm is not None and not self.begin_mm < self.end_mm:
            raise SettingError(
                "end_mm", f"must be greater than begin_mm ({self.begin_mm:g}), got {self.end_mm:g}"
            )
        if self.kind is SurfaceKind.HEIGHT_MAP and not self.height_map_file:
            raise SettingError("height_map_file", "is empty; name the file of the heights")

    def shape(self) -> Shape:
        """Return the shape in m and rad. Raises ValueError for a height map file that cannot be read."""
        height, amplitude, radius = (
            millimetres / 1000.0 for millimetres in (self.height_mm, self.amplitude_mm, self.radius_mm)
        )
        period = self.period_mm / 1000.0
        match self.kind:
            case SurfaceKind.FLAT:
                return Plane(height)
            case SurfaceKind.SLOPED:
                return Plane(height, math.radians(self.slope_deg))
            case SurfaceKind.SINUSOIDAL:
                return Sinusoidal(height, amplitude, period)
            case SurfaceKind.SINUSOIDAL_BOTH:
                return SinusoidalBoth(height, amplitude, period, self.period_across_mm / 1000.0)
            case SurfaceKind.CIRCULAR_ARC:
                return CircularArc(height, radius)
            case SurfaceKind.SPHERE:
                return Sphere(height, radius)
            case SurfaceKind.HEIGHT_MAP:
                heights = read_height_map(self.height_map_file)
                return HeightMap(height, heights, self.height_map_spacing_mm / 1000.0)
