"""Objects that plug-ins provide through entry points: controllers, robots, sensors, steps, surfaces, rewards.

A package declares one in its pyproject.toml, for example:

    [project.entry-points."hil_bridge.controllers"]
    my-controller = "my_package.control:MyController"

A package is not imported before one of its objects is selected.
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
    """Object that a plug-in provides under a given name."""

    value: Any
    where: str
    """Description of the object with its name and its package, for an error message."""
    source: str
    """Module and attribute, as declared in the entry point."""


def plugin_names(group: str) -> list[str]:
    """Return the unique names in an entry point group, sorted."""
    return sorted({point.name for point in offered().select(group=group)})


def own_names(group: str) -> list[str]:
    """Return the names that hil-bridge itself declares in an entry point group, sorted."""
    return sorted({point.name for point in offered().select(group=group) if is_own(point)})


def offers(group: str) -> list[tuple[str, str, str]]:
    """Return the name, the package with its version, and the module with its attribute for each plug-in in an entry
    point group, sorted.
    """
    points = offered().select(group=group)
    return sorted({(point.name, package_of(point), point.value) for point in points if not is_own(point)})


def find_plugin(group: str, thing: str, name: str, built_in: Collection[str] = ()) -> Found | None:
    """Return the object that a plug-in provides under a name, or None. `thing` is the word for the
    object in errors.

    Raises ConfigError with the distribution if the object cannot be loaded, if two plug-ins provide the same name,
    or if a plug-in provides a name in `built_in`.
    """
    points = list(offered().select(group=group, name=name))
    if not points:
        return None
    owners = sorted(package_of(point) for point in points)
    if name in built_in:
        raise ConfigError(f"{thing} {name!r} is built in, but {owners[0]} also provides one of that name")
    if len(points) > 1:
        raise ConfigError(f"{thing} {name!r} is provided by {' and by '.join(owners)}; uninstall one")
    (point,) = points
    where = f"{thing} {point.name!r} of {package_of(point)}"
    if EntryPoint.pattern.match(point.value) is None:
        raise ConfigError(
            f"{where} cannot be loaded: {point.value!r} is not an object reference; use module:object"
        )
    try:
        return Found(point.load(), where, point.value)
    except ModuleNotFoundError as error:
        if not is_own(point):
            refuse_old_names(where, point.module, failure(error))
        raise missing(point, where, error.name or point.module) from error
    # A plug-in may raise any exception while it is imported.
    except (Exception, SystemExit) as error:
        refuse_old_names(where, point.module, failure(error))
        raise ConfigError(f"{where} cannot be loaded: {failure(error)}") from error


def missing(point: EntryPoint, where: str, module: str) -> ConfigError:
    """Return the error about an object whose module requires a module that is not installed. `where` describes the
    object.
    """
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
    """Raise ConfigError with all uses of old names in a package. `where` describes the object of the package.
    `failed` is the error that it raised, which may have another cause.
    """
    if names := old_names(module):
        raised = f"; it fails with {failed}" if failed else ""
        raise ConfigError(
            f"{where} was written for hil-bridge before version {SINCE}: {names}{raised}",
            remedy="see Upgrading a package in the documentation",
        )
