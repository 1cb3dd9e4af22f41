"""Python interface: runs and devices for your programs, notebooks and tests.

    from hil_bridge import simulate

    stop = {"on": "robot", "fault": "emergency-stop", "phase": "track"}
    result = simulate({"run": {"duration_s": 3.0}}, faults=[stop])
    assert result.outcome == "stopped"

The names in `__all__` are stable: they change only with a note in the change log. Every other name is private.
Lengths are m, times s, forces N, moments N·m, angles rad, unless a name ends in another unit. Poses are those of the
tool in the robot's base frame, wrenches those on the tool in the tool frame.

Every error that an operator is meant to read is a `BridgeError`; its text is one line that says what to do.
"""

import asyncio
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractAsyncContextManager
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

from hil_bridge.clock import Main
from hil_bridge.clock import run_real as _run_real
from hil_bridge.clock import run_virtual as _run_virtual
from hil_bridge.control.types import Command, Controller, Measurement
from hil_bridge.errors import (
    BridgeError,
    Cause,
    ConfigError,
    DeviceError,
    OrderRefused,
    Part,
    Reason,
    SafetyStop,
    TransportBroken,
    TransportClosed,
    TransportEnded,
    TransportError,
    TransportUnavailable,
)
from hil_bridge.record import CycleRecord, Outcome
from hil_bridge.record.foreign import BagChoices
from hil_bridge.runs.recorded import Recording, read
from hil_bridge.runs.simulation import OpenDevices, Result, Simulation, opening_devices, simulating
from hil_bridge.settings.configuration import Config
from hil_bridge.settings.given import config_of

__all__ = [
    "BagChoices",
    "BridgeError",
    "Cause",
    "Command",
    "Config",
    "ConfigError",
    "Configuration",
    "Controller",
    "CycleRecord",
    "DeviceError",
    "Measurement",
    "OpenDevices",
    "OrderRefused",
    "Outcome",
    "Part",
    "Reason",
    "Recording",
    "Result",
    "SafetyStop",
    "Simulation",
    "TransportBroken",
    "TransportClosed",
    "TransportEnded",
    "TransportError",
    "TransportUnavailable",
    "load",
    "open_devices",
    "read",
    "run_real",
    "run_virtual",
    "simulate",
    "simulate_async",
    "simulation",
]

T = TypeVar("T")

Configuration: TypeAlias = Config | Mapping[str, Any] | Path | str | None
"""The path of a TOML file, its tables as nested mappings, a `Config`, or None for the defaults."""
Faults: TypeAlias = Sequence[Mapping[str, Any]]
"""Tables as in [[faults]]: `on`, `fault`, and when it comes."""
GivenController: TypeAlias = Controller[Any] | str | None
"""A controller object, the name of one, or None for that of the configuration."""
Observe: TypeAlias = Callable[[CycleRecord], object] | None
"""Called after each cycle with its record."""


def load(
    config: Configuration = None,
    *,
    faults: Faults = (),
    controller: GivenController = None,
    seed: int | None = None,
) -> Config:
    """Load the checked configuration of a run; the other functions here take it, and make it themselves where they are
    given something else.

    `faults` come after those of the configuration. `seed` is that of every random draw in the emulated cell. Files
    that a TOML file names are looked for beside it, those of a mapping in the working directory. Raises ConfigError
    with the key that is wrong.
    """
    return config_of(config, faults, controller, seed)


def simulate(
    config: Configuration = None,
    *,
    faults: Faults = (),
    controller: GivenController = None,
    observe: Observe = None,
    seed: int | None = None,
) -> Result:
    """Run once against the emulated cell in virtual time: as fast as possible, and identical with the same seed.

    A `controller` object satisfies `Controller`: a pure law, so that the same object may run again. `observe` is told
    each cycle; an error that it raises ends the run, the tool is retracted, and the error is raised here. No file is
    written; `Result.save` writes the recording.

    A run that the guard stops is a `Result` too. Raises ConfigError for a configuration that cannot be run, and for
    one that names a real device; other BridgeErrors when a device fails before the movement has begun.
    """
    checked = load(config, faults=faults, controller=controller, seed=seed)

    async def main() -> Simulation:
        async with simulating(checked, observe) as running:
            await running.finished()
        return running

    return run_virtual(main).result


async def simulate_async(
    config: Configuration = None,
    *,
    faults: Faults = (),
    controller: GivenController = None,
    observe: Observe = None,
    seed: int | None = None,
) -> Result:
    """Run like `simulate`, but awaitable and in a separate thread: a notebook or a server continues meanwhile.

    `observe` is called in that thread. Arguments and errors are those of `simulate`.
    """
    return await asyncio.to_thread(
        simulate, config, faults=faults, controller=controller, observe=observe, seed=seed
    )


def simulation(
    config: Configuration = None,
    *,
    faults: Faults = (),
    controller: GivenController = None,
    observe: Observe = None,
    seed: int | None = None,
) -> AbstractAsyncContextManager[Simulation]:
    """Open a run with access to its robot, sensor, clock, truth and panel while it continues, for `async with`.

    The run is a task of its own: `Simulation.start`, `reached` or `finished` begins it. A run that still goes when the
    context is left retracts first, also when the context is left by an error. Then `Simulation.result` is there.

    Under `run_virtual` it is in virtual time, under `run_real` or any other event loop in real time. There, a
    configuration may name real devices; the record is kept in memory. Arguments and errors are those of `simulate`.
    """
    return simulating(load(config, faults=faults, controller=controller, seed=seed), observe)


def open_devices(config: Configuration = None) -> AbstractAsyncContextManager[OpenDevices]:
    """Open robot and sensor alone, started, for a script that drives a cell itself, for `async with`.

    What has no URL is emulated, but for the sensor beside a real robot: that robot is opened alone, and to ask for the
    sensor raises ConfigError. No guard watches such a script: the robot does what it is told, within its own limits.
    All is closed when the context is left. Raises ConfigError for a URL, for planned faults and for a real device in
    virtual time, TransportUnavailable for a wire.
    """
    return opening_devices(load(config))


def run_virtual(main: Main[T]) -> T:
    """Run a coroutine, or the coroutine that a function makes, in a new loop in virtual time.

    Where an event loop runs already, as in a notebook, it is run in another thread. Stricter than real time: raises
    LeakedTasks for tasks left behind, and VirtualDeadlock when nothing can happen any more. It also raises errors of
    callbacks, which real time would only have logged.
    """
    if not _in_loop():
        return _run_virtual(main)
    with ThreadPoolExecutor(1, "virtual time") as executor:
        return executor.submit(_run_virtual, main).result()


def run_real(main: Main[T], busy_poll_s: float = 0.0) -> T:
    """Run a coroutine, or the coroutine that a function makes, in real time; like `asyncio.run`.

    `busy_poll_s` is for how long the loop looks again and again before it sleeps, s. Raises ConfigError where an event
    loop runs already, as in a notebook: there the coroutine is to be awaited.
    """
    if _in_loop():
        if asyncio.iscoroutine(main):
            main.close()
        raise ConfigError("an event loop runs here already, as in a notebook: await the coroutine itself")
    return _run_real(main, busy_poll_s)


def _in_loop() -> bool:
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return False
    return True
