"""Factory of S3 robots for a cell."""

from collections.abc import Callable

from emulators.devices.s3.controller import S3Controller
from emulators.devices.s3.profile import S3Profiles
from emulators.devices.s3.site import EMPTY_SITE, S3Site
from emulators.seams import StartPose


def make_robot(
    profiles: S3Profiles, site: S3Site = EMPTY_SITE
) -> Callable[[StartPose, float, int], S3Controller]:
    """Return a factory of S3 controllers with their arms: `emulators.seams.RobotFactory`."""
    return lambda start, now, seed: S3Controller(profiles, start, now, seed, site)
