"""Optimiser for tuning searches and fault hunts, provided by SciPy, which is an optional dependency."""

from collections.abc import Callable

from hil_bridge.errors import ConfigError
from hil_bridge.errors.extras import install_command


def optimiser() -> Callable[..., object]:
    """Return SciPy's differential evolution. Raises ConfigError if SciPy is not installed."""
    try:
        from scipy.optimize import differential_evolution
    except ImportError as error:
        raise ConfigError(f"an optimiser needs the package scipy; {install_command('tune')}") from error
    function: Callable[..., object] = differential_evolution
    return function
