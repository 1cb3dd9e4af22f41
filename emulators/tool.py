"""Tool behind the sensor: its settings, and the matrices that map forces on it to wrenches on the sensor."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from emulators.seams import Floats
from protocol.geometry import Quaternion, Vector, rotation_rows
from protocol.marks import Mark, SettingError, above, between, check_settings, setting

_HEAVIEST_KG = 10.0
"""Largest mass of the tool, kg. Chosen."""


@dataclass(frozen=True, slots=True)
class ToolProfile:
    """Tool behind the sensor, which a spindle may turn."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    length_mm: float = setting(
        200.0, Mark.CHOSEN, "distance from sensor to tip along tool z", between(0.0, 1000.0), unit="mm"
    )
    mass_kg: float = setting(
        0.5, Mark.CHOSEN, "mass that the sensor carries", between(0.0, _HEAVIEST_KG), unit="kg"
    )
    centre_of_gravity_mm: Vector = setting(
        (0.0, 0.0, 80.0), Mark.CHOSEN, "centre of gravity of that mass in the sensor frame", unit="mm"
    )
    stiffness_n_m: tuple[float, float] | None = setting(
        None,
        Mark.CHOSEN,
        "stiffness of the tool along its z axis and across it, on a compliant arm; by default the tool is rigid",
        above(0.0),
        unit="N/m",
    )
    face_radius_mm: float = setting(
        0.0,
        Mark.CHOSEN,
        "radius of the tool's face, a flat disc about the tip, perpendicular to tool z; 0 for a point",
        between(0.0, 500.0),
        unit="mm",
    )
    face_rings: int = setting(
        3,
        Mark.CHOSEN,
        "rings of contact points around the centre of that face: 1 gives 7 points, 2 give 19, 3 give 37",
        between(1, 8),
    )
    spindle_rpm: float = setting(
        0.0,
        Mark.CHOSEN,
        "speed at which a spindle turns the tool about tool z; 0: no spindle",
        between(0.0, 30_000.0),
        unit="1/min",
    )
    unbalance_g_mm: float = setting(
        2.5,
        Mark.ASSUMED,
        "unbalance of the turning parts; its force acts at the tip",
        between(0.0, 10_000.0),
        unit="g·mm",
    )
    """Grade G at speed ω permits U = G m / ω: G6.3, 0.5 kg and 12 000/min give 2.5 g·mm, and G2.5 gives 1.0 g·mm.

    Source: ISO 21940-11, which lists machine tools under G6.3 and their drives under G2.5. Assumed: mass and rated
    speed.
    """
    radial_run_out_um: float = setting(
        20.0,
        Mark.ASSUMED,
        "total indicator run-out of the tip perpendicular to tool z",
        between(0.0, 1000.0),
        unit="µm",
    )
    """Source: ISO 15488, table 4: class 2 permits 20 µm for a collet of 10 to 26 mm. Assumed: an exact spindle."""
    axial_run_out_um: float = setting(
        20.0,
        Mark.ASSUMED,
        "total indicator run-out of tip or face along tool z",
        between(0.0, 1000.0),
        unit="µm",
    )
    """Assumed: as much as the radial run-out. A worn or badly clamped disc has several times as much."""

    def __post_init__(self) -> None:
        if _HEAVIEST_KG < self.mass_kg <= _HEAVIEST_KG * 1e3:
            raise SettingError(
                "mass_kg",
                f"must be at most {_HEAVIEST_KG:g}, got {self.mass_kg:g}; the unit is kg, did you mean "
                f"{self.mass_kg * 1e-3:g}?",
            )
        check_settings(self)


def rotation_matrix(quaternion: Quaternion) -> Floats:
    """Return the matrix (3, 3) whose columns are the axes of the rotated frame, for a unit quaternion w x y z."""
    return np.array(rotation_rows(quaternion))


def moment_matrix(arm: Vector) -> Floats:
    """Return the matrix (3, 3) that maps row forces to row moments. `arm` is the point at which the force acts, m."""
    x, y, z = arm
    return np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])


def force_to_wrench(rotation: Floats, moment: Floats) -> Floats:
    """Return the matrix (3, 6) that maps row forces in the base frame to row wrenches in the sensor frame.

    `rotation` (3, 3) is the orientation of the sensor frame in the base frame. `moment` (3, 3) is the
    `moment_matrix` of the point at which the force acts, in the sensor frame.
    """
    matrix = np.empty((3, 6))
    matrix[:, :3] = rotation
    matrix[:, 3:] = rotation @ moment
    return matrix
