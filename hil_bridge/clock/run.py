"""Execution of a coroutine in real time or in virtual time."""

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any, TypeAlias, TypeVar

from hil_bridge.clock.order import OrderDraws
from hil_bridge.clock.polling import BusyPolling, WatchfulLoop, WatchfulSelector
from hil_bridge.clock.virtual import VirtualLoop, VirtualTimeError, describe_tasks

T = TypeVar("T")
Main: TypeAlias = Coroutine[Any, Any, T] | Callable[[], Coroutine[Any, Any, T]]


Stray: TypeAlias = Callable[[BaseException], bool]
"""Function that receives a SystemExit or KeyboardInterrupt raised by a callback or another task. It returns whether
the loop continues.
"""


class LeakedTasks(VirtualTimeError):
    """Error of a main coroutine that has returned while tasks which it did not cancel are still running."""


def run_real(main: Main[T], busy_poll_s: float = 0.0) -> T:
    """Run a coroutine, or the coroutine that a function returns, in real time, like `asyncio.run`.

    `busy_poll_s` is the time for which the loop polls before it sleeps, s; see `BusyPolling`.
    """
    return run_real_on(main, busy_poll_s, None)


def run_real_on(main: Main[T], busy_poll_s: float, on_stray: Stray | None) -> T:
    """Run a coroutine as `run_real` does. `on_stray` receives exceptions that leave the loop. The caller handles
    signals.
    """
    selector = BusyPolling(busy_poll_s) if busy_poll_s else WatchfulSelector()
    with asyncio.Runner(loop_factory=lambda: WatchfulLoop(selector)) as runner:
        return _run_to_end(runner, main, [], on_stray)


def run_virtual(main: Main[T], order: OrderDraws | None = None) -> T:
    """Run a coroutine, or the coroutine that a function returns, in a new loop in virtual time.

    `order` draws the order of callbacks that are due together; None stands for first in, first out.

    Virtual time is stricter than real time. It raises LeakedTasks if tasks are left running, and VirtualDeadlock if
    nothing can happen any more. It also raises errors of callbacks, which real time would only log.
    """
    return run_virtual_on(main, None, order)


def run_virtual_on(main: Main[T], on_stray: Stray | None, order: OrderDraws | None = None) -> T:
    """Run a coroutine as `run_virtual` does. `on_stray` receives exceptions that leave the loop."""
    unhandled: list[dict[str, Any]] = []
    leaked: list[str] = []
    try:
        with asyncio.Runner(loop_factory=lambda: VirtualLoop(order)) as runner:
            runner.get_loop().set_exception_handler(lambda _, context: unhandled.append(context))
            result = _run_to_end(runner, main, leaked, on_stray)
    except Exception as error:
        for context in unhandled:
            error.add_note(f"before that: {context['message']}: {context.get('exception')!r}")
        raise
    for context in unhandled:
        if isinstance(cause := context.get("exception"), Exception):
            cause.add_note(context["message"])
            raise cause
    if leaked:
        raise LeakedTasks(f"tasks were still running at the end: {leaked[0]}")
    return result


def _run_to_end(runner: asyncio.Runner, main: Main[T], leaked: list[str], on_stray: Stray | None) -> T:
    """Run a coroutine to its end, even if an exception leaves the loop, provided that `on_stray` accepts the
    exception.

    Asyncio lets a SystemExit or KeyboardInterrupt of any callback leave the loop at once. A pressing tool would
    then be left in contact. The task returns nothing, because `asyncio.Runner` formats its handler of Ctrl-C, the
    task and its result as text at each end. That takes longer than a short run if the result contains arrays.
    """
    result: list[T] = []
    watched = _watched(main, leaked, result)
    if on_stray is None:
        runner.run(watched)
        return result[0]
    loop = runner.get_loop()
    task = loop.create_task(watched)
    while True:
        try:
            loop.run_until_complete(task)
            return result[0]
        except (SystemExit, KeyboardInterrupt) as error:
            if task.done() or not on_stray(error):
                raise


async def _watched(main: Main[T], leaked: list[str], result: list[T]) -> None:
    result.append(await (main() if callable(main) else main))
    me = asyncio.current_task()
    left = {task for task in asyncio.all_tasks() if task is not me and not task.cancelling()}
    if left:
        leaked.append(describe_tasks(left))
