"""The base of the models against which sequences of acts are tried: a loop in virtual time of its own."""

import asyncio
from collections.abc import Awaitable
from contextlib import AsyncExitStack
from typing import Any

from hypothesis import HealthCheck, settings
from hypothesis.stateful import RuleBasedStateMachine, run_state_machine_as_test

from hil_bridge.clock import VirtualLoop
from hil_bridge.testing.naming import Finding


class Model(RuleBasedStateMachine):
    """A model with a device, its client and a loop."""

    def __init__(self) -> None:
        super().__init__()
        self._runner = asyncio.Runner(loop_factory=VirtualLoop)
        self._unhandled: list[dict[str, Any]] = []
        self._runner.get_loop().set_exception_handler(lambda _, context: self._unhandled.append(context))
        self._stack = AsyncExitStack()

    def run(self, act: Awaitable[Any]) -> Any:
        """The result of an act, in virtual time."""

        async def main() -> Any:
            return await act

        result = self._runner.run(main())
        for context in self._unhandled:
            raise Finding(f"a callback of the client has failed: {context.get('exception')!r}")
        return result

    def end(self, act: Awaitable[Any]) -> None:
        """Do the last act, and close the loop."""

        async def main() -> None:
            await act

        try:
            self._runner.run(main())
        finally:
            self._runner.close()


def try_sequences(model: type[Model], case: object, examples: int, steps: int) -> None:
    """Try so many sequences of at most so many steps. The one that fails is told, as short as it can be made."""
    machine = type(model.__name__, (model,), {"case": case})
    run_state_machine_as_test(
        machine,
        settings=settings(
            max_examples=examples,
            stateful_step_count=steps,
            deadline=None,
            derandomize=True,
            database=None,
            suppress_health_check=list(HealthCheck),
        ),
    )
