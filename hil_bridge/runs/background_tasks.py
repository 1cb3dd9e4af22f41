"""Background tasks of a run, which never end its movement."""

import asyncio
from collections.abc import AsyncIterator, Coroutine
from contextlib import asynccontextmanager, suppress
from typing import Any


@asynccontextmanager
async def background_task(work: Coroutine[Any, Any, None], name: str) -> AsyncIterator[None]:
    """Run `work` as a task with the given name while the context is open, and cancel it on exit.

    A failure of `work` is raised on exit: an observer of a run must not end its movement, as a task group would. An
    exception from inside the context is raised unchanged; a task group would wrap it.
    """
    task = asyncio.create_task(work, name=name)
    try:
        yield
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task
