"""Base class of the stateful models that check sequences of actions, each in its own virtual-time event loop."""

import asyncio
from collections.abc import Awaitable
from contextlib import AsyncExitStack
from typing import Any

from hypothesis import HealthCheck, settings
from hypothesis.stateful import RuleBasedStateMachine, run_state_machine_as_test

from hil_bridge.clock import VirtualLoop
from hil_bridge.testing.naming import Finding


class Model(RuleBasedStateMachine):
    """Stateful model of a device and its client, with its own event loop."""

    def __init__(self) -> None:
        super().__init__()
        self._runner = asyncio.Runner(loop_factory=VirtualLoop)
        self._unhandled: list[dict[str, Any]] = []
        self._runner.get_loop().set_exception_handler(lambda _, context: self._unhandled.append(context))
        self._stack = AsyncExitStack()

    def run(self, act: Awaitable[Any]) -> Any:
        """Run an action in virtual time and return its result."""

        async def main() -> Any:
            return await act

        result = self._runner.run(main())
        for context in self._unhandled:
            raise Finding(f"a callback of the client failed: {context.get('exception')!r}")
        return result

    def end(self, act: Awaitable[Any]) -> None:
        """Run the last action, and close the loop."""

        async def main() -> None:
            await act

        try:
            self._runner.run(main())
        finally:
            self._runner.close()


def try_sequences(model: type[Model], case: object, examples: int, steps: int) -> None:
    """Try `examples` sequences of at most `steps` steps. A failing sequence is reported in its shortest form."""
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
