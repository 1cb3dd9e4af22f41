"""Entry points of installed packages: all that they offer to hil-bridge, without importing any of it."""

import sys
from functools import lru_cache
from importlib.metadata import EntryPoint, EntryPoints, distributions

_PREFIX = "hil_bridge."
GROUPS = tuple(
    f"{_PREFIX}{name}"
    for name in (
        "commands",
        "commands.config",
        "commands.decode",
        "commands.emulate",
        "commands.identify",
        "commands.list",
        "controllers",
        "extensions",
        "rewards",
        "robots",
        "sensors",
        "steps",
        "surfaces",
    )
)
"""Entry point groups that are looked through."""
OWN = frozenset(("hil_bridge", "emulators", "protocol"))
"""Outermost modules of hil-bridge itself, whose commands and kinds of devices are entry points, too."""


def offered() -> EntryPoints:
    """All that the packages on Python's path offer."""
    return _offered(tuple(sys.path))


@lru_cache(maxsize=1)
def _offered(path: tuple[str, ...]) -> EntryPoints:
    """Return the entry points, cached because reading all packages takes milliseconds.

    Only those that name us are parsed.
    """
    packages = [one for one in distributions() if _PREFIX in (one.read_text("entry_points.txt") or "")]
    if len(packages) > 1:  # to read a name takes longer than all else
        packages = list(
            {one.name: one for one in reversed(packages)}.values()
        )  # the first on the path hides the others
    return EntryPoints(point for one in packages for point in one.entry_points if point.group in GROUPS)


def package_of(point: EntryPoint) -> str:
    """Package of an offer, with its version."""
    return f"{point.dist.name} {point.dist.version}" if point.dist else "an unknown package"


def outermost_module(point: EntryPoint) -> str:
    """Return the outermost module of an offer."""
    return point.value.partition(":")[0].partition(".")[0].strip()


def is_own(point: EntryPoint) -> bool:
    """Return whether an offer comes with hil-bridge itself."""
    return outermost_module(point) in OWN


def packages_of_modules() -> dict[str, str]:
    """Return the plug-ins, with their versions, by the outermost module of their offers."""
    return {outermost_module(point): package_of(point) for point in offered() if not is_own(point)}
