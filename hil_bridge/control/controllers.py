"""Controllers by the names under which a configuration chooses them."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

from hil_bridge.control.laws.fuzzy_control import FuzzyAdaptive, FuzzyPi, ResolutionAware
from hil_bridge.control.laws.linear import Admittance, Pi
from hil_bridge.control.laws.predictive import Predictive
from hil_bridge.control.types import Controller
from hil_bridge.errors import ConfigError
from hil_bridge.plugins import find_plugin, plugin_names

CONTROLLERS: Mapping[str, Callable[..., Controller[Any]]] = MappingProxyType(
    {kind.name: kind for kind in (FuzzyPi, FuzzyAdaptive, ResolutionAware, Pi, Admittance, Predictive)}
)
"""Every controller of ours by the name under which a configuration chooses it."""


def controller_kind(name: str) -> Callable[..., Controller[Any]]:
    """Our controller or that of another package. Raises ConfigError for a name that nobody or too many
    offer, and for a package that is broken.
    """
    kind = find_plugin(name, CONTROLLERS) or CONTROLLERS.get(name)
    if kind is None:
        known = ", ".join((*CONTROLLERS, *plugin_names()))
        raise ConfigError(f"there is no controller {name!r}; choose one of {known}")
    return kind


def make_controller(name: str, **parameters: Any) -> Controller[Any]:
    """A controller by its name. Raises ConfigError for an unknown name or a parameter that it does not
    take.
    """
    kind = controller_kind(name)
    try:
        return kind(**parameters)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"controller {name}: {error}") from error
