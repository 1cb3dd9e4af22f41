"""Closed-loop force control of a position-controlled robot, over the real link or an emulated one.

The names of `hil_bridge.api` are available here, too, and imported on first use, so that `import hil_bridge` is fast.
"""

from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hil_bridge.api import *  # noqa: F403


def __getattr__(name: str) -> Any:
    """Return an attribute of `hil_bridge.api`. Raises AttributeError if the name is unknown."""
    # `from hil_bridge import MODULE` asks here first. To load the interface for that could go round in a circle.
    if not name.startswith("_") and find_spec(f"{__name__}.{name}") is None:
        api = import_module("hil_bridge.api")
        if name in api.__all__:
            return getattr(api, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *import_module("hil_bridge.api").__all__})
