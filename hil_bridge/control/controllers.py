"""Every controller by the name under which a configuration chooses it."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

from hil_bridge.control.fuzzy_control import FuzzyAdaptive, FuzzyPi, ResolutionAware
from hil_bridge.control.linear import Admittance, Pi
from hil_bridge.control.types import Controller
from hil_bridge.errors import ConfigError

CONTROLLERS: Mapping[str, Callable[..., Controller[Any]]] = MappingProxyType(
    {kind.name: kind for kind in (FuzzyPi, FuzzyAdaptive, ResolutionAware, Pi, Admittance)}
)
"""Every controller by the name under which a configuration chooses it."""


def make_controller(name: str, **parameters: Any) -> Controller[Any]:
    """A controller by its name. Raises ConfigError for an unknown name or a parameter that it does not
    take.
    """
    kind = CONTROLLERS.get(name)
    if kind is None:
        raise ConfigError(f"there is no controller {name!r}; choose one of {', '.join(CONTROLLERS)}")
    try:
        return kind(**parameters)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"controller {name}: {error}") from error
