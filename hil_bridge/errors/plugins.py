"""Objects that packages offer through entry points: controllers, robots, sensors, steps, surfaces, rewards.

A package offers one in its pyproject.toml, for example:

    [project.entry-points."hil_bridge.controllers"]
    my-controller = "my_package.control:MyController"

Nothing of a package is imported before that which it offers is chosen.
"""

from collections.abc import Collection
from dataclasses import dataclass
from importlib.metadata import EntryPoint
from typing import Any

from hil_bridge.errors import ConfigError
from hil_bridge.errors.extras import NAME, install_command
from hil_bridge.errors.failures import failure
from hil_bridge.errors.moved_names import SINCE, old_names
from hil_bridge.errors.offers import OWN, is_own, offered, outermost_module, package_of


@dataclass(frozen=True, slots=True)
class Found:
    """An extension that a package offers under a name."""

    value: Any
    where: str
    """The thing, its name and its package, in words for an error."""
    source: str
    """Module and attribute, as the package names them."""


def plugin_names(group: str) -> list[str]:
    """Return the names that packages offer in an entry point group, each once, sorted."""
    return sorted({point.name for point in offered().select(group=group)})


def own_names(group: str) -> list[str]:
    """Return the names that hil-bridge itself offers in an entry point group, sorted."""
    return sorted({point.name for point in offered().select(group=group) if is_own(point)})


def offers(group: str) -> list[tuple[str, str, str]]:
    """Return what plug-ins offer in an entry point group: name, package with version, and place in it, sorted."""
    points = offered().select(group=group)
    return sorted({(point.name, package_of(point), point.value) for point in points if not is_own(point)})


def find_plugin(group: str, thing: str, name: str, built_in: Collection[str] = ()) -> Found | None:
    """Extension that a plug-in offers under a name, or None. `thing` is the word for it in an error.

    Raises ConfigError that names the distribution when it cannot be loaded, and when two offer the same name or one
    takes a name from `built_in`.
    """
    points = list(offered().select(group=group, name=name))
    if not points:
        return None
    owners = sorted(package_of(point) for point in points)
    if name in built_in:
        raise ConfigError(f"{thing} {name!r} is built in, but {owners[0]} offers one of that name, too")
    if len(points) > 1:
        raise ConfigError(f"{thing} {name!r} is offered by {' and by '.join(owners)}; uninstall one")
    (point,) = points
    where = f"{thing} {point.name!r} of {package_of(point)}"
    if EntryPoint.pattern.match(point.value) is None:
        raise ConfigError(
            f"{where} cannot be loaded: {point.value!r} names no object; give it as module:object"
        )
    try:
        return Found(point.load(), where, point.value)
    except ModuleNotFoundError as error:
        if not is_own(point):
            refuse_old_names(where, point.module, failure(error))
        raise missing(point, where, error.name or point.module) from error
    # Foreign code may raise anything while it is imported.
    except (Exception, SystemExit) as error:
        refuse_old_names(where, point.module, failure(error))
        raise ConfigError(f"{where} cannot be loaded: {failure(error)}") from error


def missing(point: EntryPoint, where: str, module: str) -> ConfigError:
    """Return the error for an object, named by `where`, one of whose modules is not installed."""
    outermost = module.partition(".")[0]
    package = outermost
    if outermost in OWN:
        package = NAME
    elif outermost == outermost_module(point) and point.dist is not None:
        package = point.dist.name
    install = install_command() if package == NAME else f"pip install {package}"
    return ConfigError(
        f"{where} cannot be loaded: the module {module} is missing", remedy=f"install it: {install}"
    )


def refuse_old_names(where: str, module: str, failed: str = "") -> None:
    """Raise ConfigError with all that a package uses by names of an earlier version. `where` names what it offers,
    `failed` the error that it raised, which may have another cause.
    """
    if names := old_names(module):
        raised = f"; it fails with {failed}" if failed else ""
        raise ConfigError(
            f"{where} was written for a version of hil-bridge before {SINCE}: {names}{raised}",
            remedy="see Upgrading a package in the documentation",
        )
