"""Test suites for plug-ins, and a pytest plug-in. A test module imports a suite and provides its fixture.

    import pytest
    from hil_bridge.testing import RobotCase
    from hil_bridge.testing.robot_clients import *
    from my_package.room import ROBOT

    @pytest.fixture
    def robot_client():
        return RobotCase(ROBOT)

Suites are `controllers`, `steps`, `robot_clients`, `robot_emulators`, `sensor_clients`, `sensor_emulators`, `surfaces`,
`streams` and `datagrams`; `transports` combines the last two. The names in `__all__` here and in the suites are stable.
They require pytest and hypothesis, from the extra `testing`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

try:
    import pytest
except ImportError as error:
    from hil_bridge.errors.extras import install_command

    raise ImportError(f"hil_bridge.testing requires pytest; {install_command('testing')}") from error

from hil_bridge.testing.plugin import SUITE_VERSION, SUITES

if TYPE_CHECKING:
    from hil_bridge.testing.cases import RobotCase, SensorCase, SurfaceCase
    from hil_bridge.testing.ends import DatagramCase, StreamCase

__all__ = ["SUITE_VERSION", "DatagramCase", "RobotCase", "SensorCase", "StreamCase", "SurfaceCase"]

# so that failing assertions show their values, as in a test module
pytest.register_assert_rewrite(*SUITES, f"{__name__}.ends")

_WHERE = {
    "DatagramCase": "ends",
    "RobotCase": "cases",
    "SensorCase": "cases",
    "StreamCase": "ends",
    "SurfaceCase": "cases",
}


def __getattr__(name: str) -> Any:
    """Import a case class on first use. Raises AttributeError for an unknown name."""
    if name in _WHERE:
        return getattr(import_module(f"{__name__}.{_WHERE[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
