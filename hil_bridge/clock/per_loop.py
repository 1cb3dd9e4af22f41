"""Objects that belong to one event loop and are released with it."""

import asyncio
from collections.abc import Callable
from typing import Any, TypeVar

_Thing = TypeVar("_Thing")


def of_loop(loop: asyncio.AbstractEventLoop, make: Callable[[], _Thing], name: str) -> _Thing:
    """Return the object with this name that the loop holds. The first call creates the object.

    The object is an attribute of the loop. A weak mapping from loops would keep all loops alive, because such
    objects refer to their loop.
    """
    kept: dict[str, Any] = vars(loop).setdefault("_hil_bridge", {})
    if name not in kept:
        kept[name] = make()
    thing: _Thing = kept[name]
    return thing
