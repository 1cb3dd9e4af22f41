"""Extensions from other packages, found through entry points: controllers, robots, sensors, surfaces.

A package offers one in its pyproject.toml, for example:

    [project.entry-points."hil_bridge.controllers"]
    my-controller = "my_package.control:MyController"

Nothing of a package is imported before that which it offers is chosen.
"""

import sys
from collections.abc import Collection
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import EntryPoint, EntryPoints, entry_points
from typing import Any

from hil_bridge.errors import ConfigError


@dataclass(frozen=True, slots=True)
class Found:
    """An extension that a package offers under a name."""

    value: Any
    where: str
    """The thing, its name and its package, in words for an error."""
    source: str
    """Module and attribute, as the package names them."""


GROUPS = tuple(f"hil_bridge.{name}" for name in ("controllers", "robots", "sensors", "surfaces"))
"""Entry point groups that are looked through."""


@lru_cache(maxsize=1)
def _offered(path: tuple[str, ...]) -> EntryPoints:
    """All that the packages on Python's path offer: to look through them takes milliseconds."""
    return EntryPoints(point for group in GROUPS for point in entry_points(group=group))


def plugin_names(group: str) -> list[str]:
    """Names that other packages offer in an entry point group, each once, sorted."""
    return sorted({point.name for point in _offered(tuple(sys.path)).select(group=group)})


def offers(group: str) -> list[tuple[str, str, str]]:
    """Offers of other packages in an entry point group: name, package with version, and place in it, sorted."""
    points = _offered(tuple(sys.path)).select(group=group)
    return sorted({(point.name, _distribution(point), point.value) for point in points})


def find_plugin(group: str, thing: str, name: str, built_in: Collection[str] = ()) -> Found | None:
    """Extension that another package offers under a name, or None. `thing` is the word for it in an error.

    Raises ConfigError that names the distribution when it cannot be loaded, and when two offer the same name or one
    takes a name from `built_in`.
    """
    points = list(_offered(tuple(sys.path)).select(group=group, name=name))
    if not points:
        return None
    owners = sorted(_distribution(point) for point in points)
    if name in built_in:
        raise ConfigError(f"{thing} {name!r} is built in, but {owners[0]} offers one of that name, too")
    if len(points) > 1:
        raise ConfigError(f"{thing} {name!r} is offered by {' and by '.join(owners)}; uninstall one")
    (point,) = points
    where = f"{thing} {point.name!r} of {_distribution(point)}"
    try:
        return Found(point.load(), where, point.value)
    # Foreign code may raise anything while it is imported.
    except Exception as error:
        lines = str(error).splitlines() or [""]
        raise ConfigError(f"{where} cannot be loaded: {type(error).__name__}: {lines[0]}") from error


def _distribution(point: EntryPoint) -> str:
    return f"{point.dist.name} {point.dist.version}" if point.dist else "an unknown package"
