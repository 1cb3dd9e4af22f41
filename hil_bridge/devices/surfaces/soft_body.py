"""Kind of surface `soft-body`."""

from emulators.seams import SurfaceFactory
from emulators.surface.contact import Contact
from emulators.surface.faults import SURFACE_FAULTS
from emulators.surface.soft_body import SoftBodyProfile
from hil_bridge.devices.kinds import SurfaceKind


def _make(profile: SoftBodyProfile) -> SurfaceFactory:
    return lambda changed: Contact(profile, changed)


SOFT_BODY = SurfaceKind(
    "soft-body",
    "Soft body, measured on a real one: it stiffens with depth and relaxes",
    SoftBodyProfile,
    _make,
    SURFACE_FAULTS,
)
