"""Reduction of an order of callbacks under which a run differs, to the fewest callbacks that must change places."""

from collections.abc import Callable, Collection, Mapping

from hil_bridge.clock import run_virtual
from hil_bridge.clock.order import Deviation, OrderDraws, VirtualOrder
from hil_bridge.lab.campaign.criteria import Figure
from hil_bridge.lab.invariants import Evidence, Promise
from hil_bridge.lab.invariants.order import other_in_drawn_order
from hil_bridge.record import Recording
from hil_bridge.record.topics import RECORDS
from hil_bridge.runs.simulation import simulating
from hil_bridge.settings.configuration import Config


def describe_order(config: Config, figures: Mapping[str, Figure]) -> tuple[str, ...]:
    """Return the fewest callbacks that must change places for a run to differ, as text; none for a run that keeps the
    promise of equal decisions.
    """
    promises = figures.get("promises")
    if not isinstance(promises, dict) or Promise.ORDER not in promises:
        return ()
    return tuple(map(str, fewest_deviations(config)))


def fewest_deviations(config: Config) -> tuple[Deviation, ...]:
    """Return the fewest deviations from first in, first out under which the decisions of a run differ; none if no order
    of the configuration changes them.
    """
    order = config.virtual
    usual = record(config.model_copy(update={"virtual": VirtualOrder()}), None)

    def differs(only: Collection[int]) -> bool:
        drawn = record(config, OrderDraws(order, only, active=False))
        return any(other_in_drawn_order(Evidence(drawn, config, usual=usual)))

    numbers = [one.number for one in _deviations(config, order, None)]
    if not differs(numbers):
        return ()
    left = frozenset(fewest(numbers, differs))
    return tuple(one for one in _deviations(config, order, left) if one.number in left)


def record(config: Config, order: OrderDraws | None) -> Recording:
    """Return the recording of a run in virtual time, with callbacks in an order."""

    async def main() -> Recording:
        async with simulating(config, None, RECORDS) as running:
            await running.finished()
        return running.result.recording

    return run_virtual(main, order)


def fewest(numbers: list[int], fails: Callable[[Collection[int]], bool]) -> list[int]:
    """Return a part of the numbers that still fails; without any one of them, it does not.

    Delta debugging: halves, quarters and smaller parts are left out in turn. Source: A. Zeller and R. Hildebrandt,
    Simplifying and Isolating Failure-Inducing Input, IEEE Trans. Software Eng. 28(2), 2002.
    """
    parts = 2
    while len(numbers) > 1:
        size = -(-len(numbers) // parts)
        pieces = [numbers[start : start + size] for start in range(0, len(numbers), size)]
        for candidate in (*pieces, *([n for n in numbers if n not in piece] for piece in pieces)):
            if len(candidate) < len(numbers) and fails(frozenset(candidate)):
                numbers, parts = candidate, max(parts - 1, 2)
                break
        else:
            if size == 1:
                break
            parts = min(2 * parts, len(numbers))
    return numbers


def _deviations(config: Config, order: VirtualOrder, only: Collection[int] | None) -> list[Deviation]:
    deviations: list[Deviation] = []
    record(config, OrderDraws(order, only, deviations.append, active=False))
    return deviations
