"""Common parts of the rigs for emulated robots and sensors: tampered transports, timeouts, time and faults."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Mapping, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Any

import pytest

from emulators.faults import Fault, Ledger
from hil_bridge.clock import Clock
from hil_bridge.devices.wiring import Serving
from hil_bridge.errors import BridgeError
from hil_bridge.testing.cancelling import MOST, cancelled_at
from hil_bridge.testing.naming import Finding
from hil_bridge.testing.tampering import TamperedTransport, flipped, garbage, lengthened, shortened
from hil_bridge.transports import Transport

DAMAGES: Mapping[str, Callable[[Any, int], Sequence[Any]]] = {
    "flipped": lambda data, count: (flipped(data, 11 * count),),
    "shortened": lambda data, count: (shortened(data),),
    "lengthened": lambda data, count: (lengthened(data),),
    "garbage": lambda data, count: (garbage(data), data),
}
"""Functions that damage the data of a client, by kind of damage; each receives the data and its sequence number."""


class Rig:
    """Emulated device, with the transports of its clients."""

    patience_s: float
    """Longest wait for a call, s. Chosen: longer than any client may wait for the device."""

    def __init__(self, clock: Clock, faults: Mapping[str, Mapping[str, Fault]]) -> None:
        self.clock = clock
        self.ledger = Ledger(faults)
        self.wires: list[TamperedTransport] = []
        """Transports of the clients, in the order in which they were opened."""

    def wrap(self, device: str, wire: Transport[Any]) -> Transport[Any]:
        """Wrap a transport that a client opens."""
        meddled = TamperedTransport(wire)
        self.wires.append(meddled)
        return meddled

    async def within(self, answer: Awaitable[Any], name: str) -> Any:
        """Return the result of an awaitable, which must complete or fail within the timeout."""
        try:
            async with asyncio.timeout(self.patience_s):
                return await answer
        except TimeoutError:
            raise Finding(
                f"`{name}` waits forever: no answer and no error within {self.patience_s:g} s"
            ) from None

    async def wait(self, seconds: float) -> None:
        """Let time pass, and end faults that are due."""
        ends = self.clock.now() + seconds
        while (due := self.ledger.next_deadline()) is not None and due < ends:
            await self.clock.sleep_until(due)
            self.ledger.handle_deadline(due)
        await self.clock.sleep_until(ends)

    # --- faults

    def inject(self, target: str, fault: str) -> bool:
        """Inject a fault with its default parameters; return False if the device does not support it at this time."""
        entry = self.ledger.table[target][fault]
        # One of them must not be 0.
        amounts: dict[str, object] = {
            name: max(entry.parameters[name].maximum / 100.0, 1e-3) for name in entry.amounts[:1]
        }
        try:
            self.ledger.inject(target, fault, self.clock.now(), amounts)
        except ValueError:
            return False
        return True

    def mend(self) -> None:
        """End all active faults."""
        self.ledger.mend(self.clock.now())

    async def begin_each(self, handlers: Mapping[str, Mapping[str, Any]], word: str) -> None:
        """Inject each fault of the table briefly, and check that every fault handler belongs to the table. `word`
        names the device.
        """
        listed = {(on, name) for on, table in self.ledger.table.items() for name in table}
        handled = {(on, name) for on, table in handlers.items() for name in table}
        if extra := handled - listed:
            raise Finding(f"the {word} handles {sorted(extra)[0]}, which is not in the table of its faults")
        begun = 0
        for on, name in sorted(listed):
            begun += self.inject(on, name)
            await self.wait(0.05)
        if listed and not begun:
            raise Finding("no fault can begin with its defaults")
        self.mend()
        await self.wait(0.1)

    # --- hostile or cancelled clients

    def damage_sent(self, damage: str, first: int, every: int) -> None:
        """Damage the piece of client data with this sequence number, and further pieces periodically."""
        alter, count = DAMAGES[damage], 0

        def meddle(data: Any) -> Sequence[Any]:
            nonlocal count
            count += 1
            return alter(data, count) if count >= first and not (count - first) % every else (data,)

        for wire in self.wires:
            wire.alter_sent = meddle

    async def cancel_everywhere(
        self,
        session: Callable[[], Coroutine[Any, Any, None]],
        check: Callable[[int, str], Awaitable[None]] | None = None,
    ) -> None:
        """Cancel a session at its first await, its second, and so on to its end; check that nothing is left behind.

        The transports of the session must be closed, and no task may remain. `check` is called with the number of
        the await and its description.
        """
        before = asyncio.all_tasks()
        for number in range(MOST):
            self.wires.clear()
            went_on = await cancelled_at(number, session)
            where = f"cancelled at its await number {number}"
            if left := [wire.name for wire in self.wires if not wire.closed]:
                raise Finding(f"{where}, the client leaks a wire: {left[0]} is not closed")
            await self.wait(0.3)
            if tasks := asyncio.all_tasks() - before:
                raise Finding(f"{where}, the client leaves a task behind: {tasks.pop().get_name()}")
            if check is not None:
                await check(number, where)
            if not went_on:
                return


@asynccontextmanager
async def serving_in_memory(clock: Clock) -> AsyncIterator[Serving]:
    """Serve an emulated device in memory. Raises the errors of its code, but not transport errors."""
    failed: list[BaseException] = []
    async with AsyncExitStack() as stack:
        yield Serving(clock, stack, failed.append, lambda text: None)
        if failed and not isinstance(failed[0], BridgeError):
            raise failed[0]


def try_each_fault(kind: Any, phase: str, attempt: Callable[[str, str], None]) -> None:
    """Try each fault that the emulator of a kind supports, and name the fault in case of a failure."""
    faults = [(on, name) for on, table in kind.emulation.faults.items() for name in table]
    if not faults:
        pytest.skip(f"the emulator of {kind.name} has no faults")
    for target, fault in faults:
        try:
            attempt(target, fault)
        except BaseException as error:
            error.add_note(f"the fault was {target}: {fault}, phase {phase}")
            raise
