"""Background tasks of a run, which never end its movement."""

import asyncio
from collections.abc import AsyncIterator, Coroutine
from contextlib import asynccontextmanager, suppress
from typing import Any


@asynccontextmanager
async def background_task(work: Coroutine[Any, Any, None], name: str) -> AsyncIterator[None]:
    """Run `work` as a task of this name while the context is open; cancel it at the end.

    A failure of the work is raised at the end: an observer of a run must not end its movement, as a task group would.
    An error from inside stays what it is, where a group would wrap it.
    """
    task = asyncio.create_task(work, name=name)
    try:
        yield
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task
