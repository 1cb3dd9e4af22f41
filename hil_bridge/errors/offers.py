"""Entry points for hil-bridge that installed packages declare, read without importing the packages."""

import json
import sys
from collections.abc import Collection
from functools import lru_cache
from importlib.metadata import Distribution, EntryPoint, EntryPoints, distributions

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
"""Entry point groups of hil-bridge."""
OWN = frozenset(("hil_bridge", "emulators", "protocol"))
"""Top-level packages of hil-bridge itself. Its commands and kinds of devices are entry points as well."""


def offered() -> EntryPoints:
    """Return the entry points for hil-bridge from all packages on Python's path."""
    return _entry_points(tuple(sys.path))


@lru_cache(maxsize=1)
def _entry_points(path: tuple[str, ...]) -> EntryPoints:
    """Return the entry points for hil-bridge. They are cached, because reading all packages takes milliseconds.

    Only packages with an entry point group of hil-bridge are parsed.
    """
    packages = [one for one in distributions() if _PREFIX in (one.read_text("entry_points.txt") or "")]
    if len(packages) > 1:  # reading a name takes longer than everything else
        packages = list(
            {one.name: one for one in reversed(packages)}.values()
        )  # the first on the path hides the others
    return EntryPoints(point for one in packages for point in one.entry_points if point.group in GROUPS)


def package_of(point: EntryPoint) -> str:
    """Return the package of an entry point, with its version."""
    return _name_and_version(point.dist) if point.dist else "an unknown package"


@lru_cache
def _name_and_version(package: Distribution) -> str:
    """Return the name of a package with its version. It is cached, because each reading parses the metadata again."""
    return f"{package.name} {package.version}"


def outermost_module(point: EntryPoint) -> str:
    """Return the top-level package of an entry point."""
    return point.value.partition(":")[0].partition(".")[0].strip()


def is_own(point: EntryPoint) -> bool:
    """Return whether an entry point belongs to hil-bridge itself."""
    return outermost_module(point) in OWN


def modules_named(texts: Collection[str]) -> tuple[str, ...]:
    """Return the top-level packages of the plug-ins whose names are strings in one of these JSON texts, sorted."""
    points = [point for point in offered() if not is_own(point)]
    named = (point for point in points if any(json.dumps(point.name) in text for text in texts))
    return tuple(sorted({outermost_module(point) for point in named}))


def packages_of_modules() -> dict[str, str]:
    """Return the names and versions of plug-ins, by their top-level packages."""
    return {outermost_module(point): package_of(point) for point in offered() if not is_own(point)}
