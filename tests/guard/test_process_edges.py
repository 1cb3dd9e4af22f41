"""Edges of a run's process: signals, exceptions that escape from the loop, closed files."""

import asyncio
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import hil_bridge
from hil_bridge import api
from hil_bridge.clock import run_real_on, run_virtual, run_virtual_on
from hil_bridge.errors import Cause
from hil_bridge.record import CycleRecord, EventKind, Outcome, read
from hil_bridge.runs import stopping
from hil_bridge.runs.notes import Notes
from hil_bridge.runs.signals import ASKING, BACKGROUND, ENDING, OTHERS, Signals, as_ctrl_c, signal_name

pytestmark = pytest.mark.sweep

NOT_HANDLED = {
    *("SIGKILL", "SIGSTOP"),  # the system lets no program take them
    *("SIGSEGV", "SIGBUS", "SIGFPE", "SIGILL"),  # a handler would be called for ever
    *("SIGPIPE", "SIGXFSZ"),  # Python ignores them
    *("SIGCHLD", "SIGCLD", "SIGCONT", "SIGURG", "SIGWINCH"),  # the system ignores them
    *BACKGROUND,
}
Command = Callable[..., tuple[int, str, str]]
VIRTUAL = ("run", "--virtual", "--no-view", "--duration", "2", "--record", "r.mcap")


@pytest.fixture
def defaults() -> Iterator[None]:
    """Reset every signal to its default handler, except SIGALRM, which the time-out of the tests uses."""
    names = (*OTHERS, *BACKGROUND)
    before = {number: signal.signal(number, signal.SIG_DFL) for number in map(number_of, names)}
    yield
    for number, handler in before.items():
        signal.signal(number, signal.SIG_DFL if handler is None else handler)


def number_of(name: str) -> signal.Signals:
    return signal.Signals[name]


# --- signals


def test_every_signal_is_listed_or_excluded() -> None:
    names = {name for number in signal.valid_signals() for name in names_of(number)}
    handled = {name for number in ENDING for name in names_of(number)}
    assert names - handled == NOT_HANDLED & names
    assert len(set(ENDING)) == len(ENDING) > 40


def names_of(number: int) -> set[str]:
    """All names that the system has for a signal."""
    names = {name for name, value in signal.Signals.__members__.items() if value == number}
    return names or {signal_name(number)}


@pytest.mark.usefixtures("defaults")
def test_listed_signals_are_handled_and_restored() -> None:
    before = {number: signal.getsignal(number) for number in ENDING}
    received: list[int] = []
    signals = Signals()
    with signals.installed(), signals.reacting_with(received.append):
        for number in ENDING:
            signal.raise_signal(number)
        for name in BACKGROUND:
            signal.raise_signal(number_of(name))
    assert received == list(ENDING)
    assert (signals.first, signals.count) == (ENDING[0], len(ENDING))
    assert {number: signal.getsignal(number) for number in ENDING} == before


def test_real_time_signal_has_a_name() -> None:
    assert [signal_name(number) for number in (signal.SIGTERM, signal.SIGRTMIN, signal.SIGRTMIN + 2)] == [
        "SIGTERM",
        "SIGRTMIN",
        "SIGRTMIN+2",
    ]


@pytest.mark.usefixtures("defaults")
def test_foreign_signal_handler_is_kept() -> None:
    received: list[int] = []
    signal.signal(signal.SIGUSR1, lambda number, frame: received.append(number))
    signal.signal(signal.SIGUSR2, signal.SIG_IGN)
    signals = Signals()
    with signals.installed():
        signal.raise_signal(signal.SIGUSR1)
        signal.raise_signal(signal.SIGUSR2)
    assert (received, signals.count) == ([signal.SIGUSR1], 0)


@pytest.mark.usefixtures("defaults")
@pytest.mark.parametrize("number", [*map(number_of, OTHERS), signal.SIGRTMIN + 3], ids=signal_name)
def test_other_signals_retract_and_are_named(
    hil: Command, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    sending(monkeypatch, number)
    code, output, errors = hil(*VIRTUAL)
    assert (code, errors) == (130, "")
    assert output.splitlines()[-1].startswith("left: retracted, 0.0 N")
    recording = read(Path("r.mcap"))
    assert recording.end["outcome"] == "interrupted"
    assert [event.text for event in recording.events if event.kind == EventKind.SIGNAL] == [
        signal_name(number)
    ]


def sending(monkeypatch: pytest.MonkeyPatch, *numbers: int) -> None:
    """Send the process these signals once its tool tracks the surface."""
    cycle, waiting = Notes._cycle, list(numbers)

    def signalled(self: Any, record: CycleRecord) -> None:
        cycle(self, record)
        while record.phase == "track" and waiting:
            signal.raise_signal(waiting.pop())

    monkeypatch.setattr(Notes, "_cycle", signalled)


@pytest.mark.usefixtures("defaults")
def test_signal_flood_retracts_with_few_records(hil: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    sending(monkeypatch, *[signal.SIGUSR1, signal.SIGTERM] * 500)
    code, output, _ = hil(*VIRTUAL)
    assert code == 130
    assert output.splitlines()[-1].startswith("left: retracted, 0.0 N")
    events = read(Path("r.mcap")).events
    assert len([event for event in events if event.kind == EventKind.SIGNAL]) == stopping.SIGNALS_RECORDED


@pytest.mark.usefixtures("defaults")
def test_other_commands_treat_signals_as_ctrl_c() -> None:
    for name in (*ASKING, *OTHERS):
        with pytest.raises(KeyboardInterrupt), as_ctrl_c():
            signal.raise_signal(number_of(name))


@pytest.mark.usefixtures("defaults")
def test_command_in_the_background_ignores_ctrl_c_alone() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with as_ctrl_c():
            signal.raise_signal(signal.SIGINT)
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGTERM)
    finally:
        signal.signal(signal.SIGINT, before)


# --- exceptions that leave the loop


@pytest.mark.parametrize("run", [run_virtual_on, lambda main, on_stray: run_real_on(main, 0.0, on_stray)])
@pytest.mark.parametrize("error", [SystemExit(1), KeyboardInterrupt()], ids=["exit", "keyboard"])
def test_loop_survives_callback_that_would_end_it(run: Any, error: BaseException) -> None:
    strays: list[BaseException] = []

    def leave() -> None:
        raise error

    def record_stray(stray: BaseException) -> bool:
        strays.append(stray)
        return True

    async def main() -> str:
        asyncio.get_running_loop().call_soon(leave)
        await asyncio.sleep(0)
        return "to its end"

    assert run(main, record_stray) == "to its end"
    assert strays == [error]
    with pytest.raises(type(error)):
        run(main, lambda stray: False)


# --- a run within a program


async def interrupted_at_once(turns: int, reaches: bool) -> tuple[Any, Any]:
    """Return the results of a run interrupted this number of loop iterations after its start."""
    async with api.simulation() as simulation:
        simulation.start()
        for _ in range(turns):
            await asyncio.sleep(0)
        simulation.interrupt()
        result = await simulation.finished()
        if reaches:
            with pytest.raises(hil_bridge.ConfigError, match="before the phase 'track': before the movement"):
                await simulation.reached("track")
    return result, simulation.result


@pytest.mark.parametrize("turns", [0, 1, 2, 50])
@pytest.mark.parametrize("reaches", [False, True])
def test_early_interrupt_gives_a_result(turns: int, reaches: bool) -> None:
    result, kept = run_virtual(interrupted_at_once(turns, reaches))
    assert (result.outcome, result.text) == (Outcome.INTERRUPTED, "before the movement began")
    assert (kept.outcome, kept.left) == (Outcome.INTERRUPTED, "")


@pytest.mark.parametrize("turns", [0, 2, 50])
def test_run_cancelled_before_movement_is_stopped(turns: int) -> None:
    async def main() -> Any:
        async with api.simulation() as simulation:
            task = simulation.start()
            for _ in range(turns):
                await asyncio.sleep(0)
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await simulation.finished()
        return simulation.result

    result = run_virtual(main())
    assert (result.outcome, result.cause) == (Outcome.STOPPED, Cause.CANCELLED)


def test_cancelled_wait_stays_cancelled() -> None:
    async def main() -> Any:
        async with api.simulation() as simulation:
            waiting = asyncio.ensure_future(simulation.finished())
            await asyncio.sleep(0)
            waiting.cancel()
            with pytest.raises(asyncio.CancelledError):
                await waiting
        return simulation.result

    assert run_virtual(main()).outcome is Outcome.INTERRUPTED
