"""Controllers by the names under which a configuration chooses them, ours and those of other packages.

A package offers a dataclass, its fields the parameters, that satisfies `control.types.Controller` and bears the entry
point's name as `name`. Measurements and commands are msgspec structs: `msgspec.structs.replace` makes changed ones.
"""

import dataclasses
import inspect
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, cast

from hil_bridge.control.laws.fuzzy_control import FuzzyAdaptive, FuzzyPi, ResolutionAware
from hil_bridge.control.laws.linear import Admittance, Pi
from hil_bridge.control.laws.predictive import Predictive
from hil_bridge.control.types import Controller
from hil_bridge.errors import ConfigError
from hil_bridge.plugins import Found, find_plugin, plugin_names

GROUP = "hil_bridge.controllers"
"""Entry point group of other packages' controllers."""
CONTROLLERS: Mapping[str, Callable[..., Controller[Any]]] = MappingProxyType(
    {kind.name: kind for kind in (FuzzyPi, FuzzyAdaptive, ResolutionAware, Pi, Admittance, Predictive)}
)
"""Every controller of ours by the name under which a configuration chooses it."""


def controller_names() -> list[str]:
    """Names of all controllers: ours, then those of other packages."""
    return [*CONTROLLERS, *plugin_names(GROUP)]


def controller_kind(name: str) -> Callable[..., Controller[Any]]:
    """Our controller or that of another package. Raises ConfigError for a name that no package or too many
    offer, and for a package that is broken.
    """
    found = find_plugin(GROUP, "controller", name, CONTROLLERS)
    if found is not None:
        return _checked(found, name)
    if name not in CONTROLLERS:
        raise ConfigError(f"there is no controller {name!r}; choose one of {', '.join(controller_names())}")
    return CONTROLLERS[name]


def make_controller(name: str, **parameters: Any) -> Controller[Any]:
    """A controller by its name. Raises ConfigError for an unknown name or a parameter that it does not
    take.
    """
    kind = controller_kind(name)
    try:
        return kind(**parameters)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"controller {name}: {error}") from error


def _checked(found: Found, name: str) -> Callable[..., Controller[Any]]:
    kind, where = found.value, f"{found.where}: {found.source}"
    if not (inspect.isclass(kind) and dataclasses.is_dataclass(kind)):
        raise ConfigError(f"{where} is no dataclass")
    for method in ("initial", "step"):
        if not callable(getattr(kind, method, None)):
            raise ConfigError(f"{where} has no method {method}")
    if getattr(kind, "name", None) != name:
        raise ConfigError(f"{where} must bear that as its attribute `name`")
    return cast(Callable[..., Controller[Any]], kind)
