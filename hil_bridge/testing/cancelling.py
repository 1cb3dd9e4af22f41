"""Cancellation at every await: run a coroutine repeatedly, and cancel it at its n-th suspension."""

import asyncio
import types
from collections.abc import Callable, Coroutine, Generator
from typing import Any

MOST = 200
"""Maximum number of suspensions at which a coroutine is cancelled. Chosen."""


@types.coroutine
def _counted(
    coroutine: Coroutine[Any, Any, Any], on_suspension: Callable[[], object]
) -> Generator[Any, Any, Any]:
    """Run a coroutine, and call `on_suspension` each time it waits."""
    given: Any = None
    raised: BaseException | None = None
    while True:
        try:
            waits_for = coroutine.send(given) if raised is None else coroutine.throw(raised)
        except StopIteration as ended:
            return ended.value
        on_suspension()
        given, raised = None, None
        try:
            given = yield waits_for
        except BaseException as error:
            raised = error


async def cancelled_at(number: int, make: Callable[[], Coroutine[Any, Any, Any]]) -> bool:
    """Run a coroutine and cancel it at its suspension `number`, counted from 0.

    Returns False if the coroutine completed before that suspension. Its errors are propagated.
    """
    waits = -1
    task: asyncio.Task[Any]

    def suspended() -> None:
        nonlocal waits
        waits += 1
        if waits == number:
            asyncio.get_running_loop().call_soon(task.cancel)

    async def main() -> Any:
        return await _counted(make(), suspended)

    task = asyncio.create_task(main(), name=f"cancelled at await {number}")
    try:
        await task
    except asyncio.CancelledError:
        if not task.cancelled():
            raise
    return waits >= number
