"""Built-in surfaces, tested by the suite for third-party surfaces."""

import pytest

from emulators.surface.contact import Contact, SurfaceProfile
from emulators.surface.contact import SurfaceKind as Shape
from emulators.surface.faults import SURFACE_FAULTS
from emulators.surface.materials import MaterialKind, MaterialProfile
from hil_bridge.devices.kinds import SurfaceKind
from hil_bridge.testing import SurfaceCase
from hil_bridge.testing.surfaces import *  # noqa: F403

OURS = SurfaceKind(
    "ours",
    "surface of the emulated cell",
    SurfaceProfile,
    lambda profile: lambda changed: Contact(profile, changed),
    SURFACE_FAULTS,
)
PROFILES = {
    "flat": SurfaceProfile(),
    "sloped": SurfaceProfile(kind=Shape.SLOPED, slope_deg=0.5),
    "rubber": SurfaceProfile(material=MaterialProfile(kind=MaterialKind.HUNT_CROSSLEY)),
    "foam": SurfaceProfile(material=MaterialProfile(kind=MaterialKind.STANDARD_LINEAR_SOLID)),
}


@pytest.fixture(params=list(PROFILES.values()), ids=list(PROFILES))
def surface(request):
    return SurfaceCase(OURS, settings=request.param, friction=request.param.friction)
