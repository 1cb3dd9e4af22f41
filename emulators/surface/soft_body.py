"""Soft body that a real robot pressed and rubbed: our own surface with the values from a recording of that robot.

Source: lbusellato/CoLeCT 1e297aa, a UR5e with a probe, pressed from 0.4 to 9.5 N and slid at 1.4 mm/s, 1206 rows.
The source does not state which body it was.
"""

from dataclasses import dataclass, field

from emulators.surface.materials import MaterialKind, MaterialProfile
from emulators.surface.profile import SurfaceProfile
from protocol.marks import Mark, above, at_least, between, setting


@dataclass(frozen=True, slots=True)
class SoftMaterialProfile(MaterialProfile):
    """Material of the soft body: 0.56 N at 1 mm, exponent 1.46, with relaxation."""

    kind: MaterialKind = setting(
        MaterialKind.HUNT_CROSSLEY,
        Mark.OBSERVED,
        "material law: linear, hunt_crossley or standard_linear_solid",
    )
    exponent: float = setting(
        1.46, Mark.OBSERVED, "exponent of the depth, ± 0.02 (hunt_crossley)", between(1.0, 10.0)
    )
    reference_depth_mm: float = setting(
        1.0,
        Mark.OBSERVED,
        "depth at which the force equals the force of a linear spring of the same stiffness (hunt_crossley)",
        above(0.0),
        unit="mm",
    )
    dissipation_s_m: float = setting(
        1.3,
        Mark.ASSUMED,
        "fraction of the spring's force that each m/s of approach adds; 1.3 ± 3 was measured (hunt_crossley)",
        at_least(0.0),
        unit="s/m",
    )
    relaxation_share: float = setting(
        0.11,
        Mark.DERIVED,
        "share of the force that is lost at a constant depth: 0.7 of 10 N after 5 s (hunt_crossley)",
        between(0.0, 0.99),
    )
    relaxation_time_ms: float = setting(
        5000.0,
        Mark.ASSUMED,
        "time constant of the relaxation at a constant depth (standard_linear_solid, hunt_crossley)",
        above(0.0),
        unit="ms",
    )


@dataclass(frozen=True, slots=True)
class SoftBodyProfile(SurfaceProfile):
    """Settings in `[cell.soft_body]`: the settings of our own surface with the values of the soft body."""

    stiffness_n_m: float = setting(
        560.0, Mark.OBSERVED, "force at a depth of 1 mm, divided by that depth", at_least(0.0), unit="N/m"
    )
    friction: float = setting(
        0.25, Mark.OBSERVED, "Coulomb coefficient of tangential friction, ± 0.04", at_least(0.0)
    )
    material: SoftMaterialProfile = field(default_factory=SoftMaterialProfile)
