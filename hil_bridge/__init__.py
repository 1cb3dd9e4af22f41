"""Force control of a position-controlled robot over its real wires, or over the same wires emulated.

Every name of `hil_bridge.api` is here too. It is imported when it is used first, so that `import hil_bridge` is quick.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hil_bridge.api import *  # noqa: F403


def __getattr__(name: str) -> Any:
    """A name of `hil_bridge.api`. Raises AttributeError for another."""
    if not name.startswith("_") and name in (api := import_module("hil_bridge.api")).__all__:
        return getattr(api, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *import_module("hil_bridge.api").__all__})
