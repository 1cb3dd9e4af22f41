"""Entry points of other packages: all that they offer to hil-bridge, without importing any of it."""

import sys
from functools import lru_cache
from importlib.metadata import EntryPoint, EntryPoints, entry_points

GROUPS = tuple(
    f"hil_bridge.{name}" for name in ("controllers", "rewards", "robots", "sensors", "steps", "surfaces")
)
"""Entry point groups that are looked through."""


def offered() -> EntryPoints:
    """All that the packages on Python's path offer."""
    return _offered(tuple(sys.path))


@lru_cache(maxsize=1)
def _offered(path: tuple[str, ...]) -> EntryPoints:
    """To look through them takes milliseconds."""
    return EntryPoints(point for group in GROUPS for point in entry_points(group=group))


def package_of(point: EntryPoint) -> str:
    """Package of an offer, with its version."""
    return f"{point.dist.name} {point.dist.version}" if point.dist else "an unknown package"


def packages_of_modules() -> dict[str, str]:
    """Packages that offer anything, with their versions, by the outermost module of their offers."""
    modules = {point: point.value.partition(":")[0].partition(".")[0].strip() for point in offered()}
    return {module: package_of(point) for point, module in modules.items()}
