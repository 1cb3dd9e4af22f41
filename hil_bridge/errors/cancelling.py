"""Cancellations by an operator or the event loop, told apart from exceptions of other packages."""

import asyncio

from hil_bridge.errors.failures import is_keyboard


def raise_if_interrupt(error: BaseException) -> None:
    """Raise an exception again by which an operator or the event loop ends this code."""
    if is_interrupt(error):
        raise error


def is_interrupt(error: BaseException) -> bool:
    """Whether an exception continues its way: an operator's KeyboardInterrupt, or the cancellation of the present task.

    A CancelledError that code of others raises although the task continues is its failure.
    """
    if isinstance(error, asyncio.CancelledError):
        try:
            task = asyncio.current_task()
        except RuntimeError:  # no loop runs
            return False
        return task is not None and task.cancelling() > 0
    return is_keyboard(error)
