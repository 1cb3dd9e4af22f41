"""The optimiser of searches and hunts: that of SciPy, an extra."""

from collections.abc import Callable

from hil_bridge.errors import ConfigError
from hil_bridge.errors.extras import install_command


def optimiser() -> Callable[..., object]:
    """SciPy's differential evolution. Raises ConfigError where SciPy is not installed."""
    try:
        from scipy.optimize import differential_evolution
    except ImportError as error:
        raise ConfigError(f"an optimiser needs the package scipy; {install_command('tune')}") from error
    found: Callable[..., object] = differential_evolution
    return found
