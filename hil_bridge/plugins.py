"""Controllers from other packages, found through the entry point group `hil_bridge.controllers`.

A package offers one in its pyproject.toml:

    [project.entry-points."hil_bridge.controllers"]
    my-controller = "my_package.control:MyController"

where MyController is a dataclass, its fields the parameters, that satisfies `control.types.Controller` and
bears the entry point's name as `name`. Measurements and commands are msgspec structs: `msgspec.structs.replace` makes
changed ones. Nothing of a package is imported before its controller is chosen.
"""

import dataclasses
import inspect
from collections.abc import Callable, Collection
from importlib.metadata import EntryPoint, entry_points
from typing import Any, cast

from hil_bridge.control.types import Controller
from hil_bridge.errors import ConfigError

GROUP = "hil_bridge.controllers"


def plugin_names() -> list[str]:
    """Names that other packages offer controllers under, each once, sorted."""
    return sorted({point.name for point in entry_points(group=GROUP)})


def find_plugin(name: str, built_in: Collection[str] = ()) -> Callable[..., Controller[Any]] | None:
    """The controller that another package offers under a name; None where no package does.

    Raises ConfigError that names the distribution when what it offers cannot be loaded or is no controller,
    and when two offer the same name or one takes a name from `built_in`.
    """
    points = list(entry_points(group=GROUP, name=name))
    if not points:
        return None
    owners = sorted(_distribution(point) for point in points)
    if name in built_in:
        raise ConfigError(f"controller {name!r} is built in, but {owners[0]} offers one of that name, too")
    if len(points) > 1:
        raise ConfigError(f"controller {name!r} is offered by {' and by '.join(owners)}; uninstall one")
    return _load(points[0])


def _load(point: EntryPoint) -> Callable[..., Controller[Any]]:
    where = f"controller {point.name!r} of {_distribution(point)}"
    try:
        kind: Any = point.load()
    # Foreign code may raise anything while it is imported.
    except Exception as error:
        lines = str(error).splitlines() or [""]
        raise ConfigError(f"{where} cannot be loaded: {type(error).__name__}: {lines[0]}") from error
    if not (inspect.isclass(kind) and dataclasses.is_dataclass(kind)):
        raise ConfigError(f"{where}: {point.value} is no dataclass")
    for method in ("initial", "step"):
        if not callable(getattr(kind, method, None)):
            raise ConfigError(f"{where}: {point.value} has no method {method}")
    if getattr(kind, "name", None) != point.name:
        raise ConfigError(f"{where}: {point.value} must bear that as its attribute `name`")
    return cast(Callable[..., Controller[Any]], kind)


def _distribution(point: EntryPoint) -> str:
    return f"{point.dist.name} {point.dist.version}" if point.dist else "an unknown package"
