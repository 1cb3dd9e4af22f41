"""Surface computed by MuJoCo: a body with three slide joints represents the tip, and MuJoCo returns the contact force.

The tip is placed at each sample's position and velocity, and `mj_forward` computes the constraint forces there. Nothing
is integrated over time, and the solver restarts each time. So the same sample always has the same force, whatever was
computed before: the surface has no memory.

Why the contact is a linear spring: MuJoCo's force of one contact is f = (a_ref − a_0) / (A + R). Here A = 1/M, since
the tip has the mass M and only slides; a_0 = 0, since nothing else acts on it; and R = A·(1 − d)/d, so that A + R =
1/(M·d). A negative `solref` (−k, −b) gives a_ref = (k·depth + b·speed)/d if the impedance d is the same at every depth
(`solimp` d, d). Together f = M·(k·depth + b·speed). So k is the required stiffness divided by M, and b the damping
divided by M. Source: MuJoCo's documentation, Computation, "Constraint model", and Modeling, "Solver parameters".

Friction is Coulomb friction, within an elliptic cone. Below the cone it grows with the sliding speed, by
`friction_slope_ns_m`. A soft sliding contact of MuJoCo pushes out slightly more, to be allowed more friction. A small d
and a large `impratio` keep that below 1 % at 50 mm/s.
"""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from emulators.faults import Handler
from emulators.seams import Floats, Surface, SurfaceFactory
from hil_bridge.devices.kinds import SurfaceKind
from protocol.marks import Mark, SettingError, above, at_least, check_settings, setting

TIP = "hil_bridge_tip"
"""Name of the tip in the scene."""
MASS_KG = 1.0
"""Mass M of the tip, kg. Chosen: it cancels out of the force."""
IMPEDANCE = 0.001
"""Impedance d. Chosen: far below 1, so that two bodies that touch the tip at once push as two springs do."""
IMPRATIO = 1000.0
"""Ratio of friction's impedance to the impedance of the normal force. Chosen: 1/d, the largest useful value."""
SLIDING_SHARE = 1.0 / (IMPEDANCE + (1.0 - IMPEDANCE) / IMPRATIO)
"""Friction force per speed, divided by M·b of its own `solreffriction`. Derived like that along the normal, with R
divided by `impratio`.
"""


@dataclass(frozen=True, slots=True)
class MujocoProfile:
    """Plane, sphere or MuJoCo scene, and its contact with the tip."""

    shape: str = setting("plane", Mark.CHOSEN, "plane, or sphere with its crest at the origin")
    scene_file: str = setting(
        "", Mark.CHOSEN, "scene in MJCF instead, in the robot's base frame, m; nothing in it may move"
    )
    origin_x_mm: float = setting(900.0, Mark.CHOSEN, "base x of the sphere's crest", unit="mm")
    origin_y_mm: float = setting(0.0, Mark.CHOSEN, "base y of the sphere's crest", unit="mm")
    height_mm: float = setting(590.0, Mark.CHOSEN, "base z of the plane or the crest", unit="mm")
    radius_mm: float = setting(300.0, Mark.CHOSEN, "radius of the sphere", above(0.0), unit="mm")
    tip_radius_mm: float = setting(
        0.05,
        Mark.CHOSEN,
        "radius of the tip, whose lowest point is the tool centre point",
        above(0.0),
        unit="mm",
    )
    stiffness_n_m: float = setting(5000.0, Mark.ASSUMED, "stiffness along the normal", above(0.0), unit="N/m")
    damping_ns_m: float = setting(10.0, Mark.ASSUMED, "damping along the normal", at_least(0.0), unit="N·s/m")
    friction: float = setting(0.2, Mark.ASSUMED, "Coulomb coefficient against sliding", at_least(0.0))
    friction_slope_ns_m: float = setting(
        2000.0, Mark.CHOSEN, "friction per speed up to the Coulomb friction", above(0.0), unit="N·s/m"
    )

    def __post_init__(self) -> None:
        check_settings(self)
        if self.shape not in ("plane", "sphere"):
            raise SettingError(
                "shape", f"must be plane or sphere, got {self.shape!r}; scene_file is for all others"
            )


class MujocoSurface:
    """Contact model with its own MuJoCo model and data; two surfaces share nothing."""

    remembered_until = None

    def __init__(self, profile: MujocoProfile) -> None:
        """Raises ValueError, in one line, for an invalid scene."""
        self._model = model_of(profile)
        self._data = mujoco.MjData(self._model)
        self.handlers: Mapping[str, Handler] = {}

    def force(self, positions: Floats, velocities: Floats, times: Floats) -> Floats:
        model, data, forces = self._model, self._data, np.empty_like(positions)
        for k in range(len(positions)):
            data.qpos[:] = positions[k]
            data.qvel[:] = velocities[k]
            mujoco.mj_forward(model, data)
            forces[k] = data.qfrc_constraint
        return forces

    def aside(self) -> Surface:
        return self

    def rewind(self, time: float) -> None:
        """Do nothing: there is no memory."""


def model_of(profile: MujocoProfile) -> "mujoco.MjModel":
    """Return the scene with the tip in it. Raises ValueError, in one line, for an invalid scene."""
    try:
        spec = _scene(profile)
        _add_tip(spec, profile)
        model = spec.compile()
    except (ValueError, OSError, mujoco.FatalError) as error:
        told = " ".join(str(error).split())
        raise ValueError(
            f"{profile.scene_file or profile.shape}: MuJoCo cannot load the scene: {told}"
        ) from error
    if model.nv != 3:
        raise ValueError(f"{profile.scene_file}: something in the scene can move; leave its joints out")
    return model


def _scene(profile: MujocoProfile) -> "mujoco.MjSpec":
    if profile.scene_file:
        if not os.access(profile.scene_file, os.R_OK):
            raise ValueError("the file cannot be read")
        return mujoco.MjSpec.from_file(profile.scene_file)
    spec = mujoco.MjSpec()
    x, y, z = profile.origin_x_mm / 1e3, profile.origin_y_mm / 1e3, profile.height_mm / 1e3
    if profile.shape == "plane":
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], pos=[0, 0, z])
    else:
        radius = profile.radius_mm / 1e3
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius, 0, 0], pos=[x, y, z - radius]
        )
    return spec


def _add_tip(spec: "mujoco.MjSpec", profile: MujocoProfile) -> None:
    option, radius = spec.option, profile.tip_radius_mm / 1e3
    option.gravity, option.density, option.viscosity = [0.0, 0.0, 0.0], 0.0, 0.0
    option.cone, option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, IMPRATIO
    option.solver, option.tolerance, option.iterations = mujoco.mjtSolver.mjSOL_NEWTON, 1e-12, 100
    option.disableflags, option.enableflags = mujoco.mjtDisableBit.mjDSBL_WARMSTART, 0
    tip = spec.worldbody.add_body(name=TIP, mass=MASS_KG, inertia=[1.0, 1.0, 1.0])
    tip.explicitinertial = True
    for axis in np.eye(3):
        tip.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    others = list(spec.geoms)
    tip.add_geom(name=TIP, type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius, 0, 0], pos=[0, 0, radius])
    stiffness, damping = profile.stiffness_n_m / MASS_KG, profile.damping_ns_m / MASS_KG
    sliding = profile.friction_slope_ns_m / (SLIDING_SHARE * MASS_KG)
    for number, other in enumerate(
        others
    ):  # a pair has parameters of its own, whatever those of the scene are
        other.name = other.name or f"hil_bridge_{number}"
        spec.add_pair(
            geomname1=other.name,
            geomname2=TIP,
            condim=3 if profile.friction else 1,
            friction=[profile.friction, profile.friction, 0.0, 0.0, 0.0],
            solref=[-stiffness, -damping],
            solreffriction=[-stiffness, -sliding],
            solimp=[IMPEDANCE, IMPEDANCE, 1.0, 0.5, 1.0],
        )


def make(settings: MujocoProfile) -> SurfaceFactory:
    def surface(changed: Callable[[float], object]) -> Surface:
        return MujocoSurface(settings)

    return surface


SURFACE = SurfaceKind("mujoco", "Contact computed by MuJoCo", MujocoProfile, make)
