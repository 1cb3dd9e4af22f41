"""Cancellations by an operator or the event loop, as distinct from exceptions of plug-ins."""

import asyncio

from hil_bridge.errors.failures import is_keyboard


def raise_if_interrupt(error: BaseException) -> None:
    """Raise the exception again if an operator or the event loop uses it to end this code."""
    if is_interrupt(error):
        raise error


def is_interrupt(error: BaseException) -> bool:
    """Return whether an exception must propagate: an operator's KeyboardInterrupt, or a cancellation of this task.

    A CancelledError that a plug-in raises although the task continues is a failure of the plug-in.
    """
    if isinstance(error, asyncio.CancelledError):
        try:
            task = asyncio.current_task()
        except RuntimeError:  # no loop runs
            return False
        return task is not None and task.cancelling() > 0
    return is_keyboard(error)
