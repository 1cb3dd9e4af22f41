"""Python interface: runs and devices for your programs, notebooks and tests.

    from hil_bridge import simulate

    stop = {"on": "robot", "fault": "emergency-stop", "phase": "track"}
    result = simulate({"run": {"duration_s": 3.0}}, faults=[stop])
    assert result.outcome == "stopped"

The names in `__all__` are stable: changes are announced in the change log. Every other name is private. Lengths are in
m, times in s, forces in N, moments in N·m and angles in rad, unless a name ends in another unit. Poses are of the tool
in the robot's base frame, wrenches act on the tool and are in the tool frame.

Errors for the operator are subclasses of `BridgeError`, with a message of one line that says what to do.
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
"""Configuration as the path of a TOML file, its tables as nested mappings, a `Config`, or None for the defaults."""
Faults: TypeAlias = Sequence[Mapping[str, Any]]
"""Faults as tables of [[faults]]: `on`, `fault`, and the time of injection."""
GivenController: TypeAlias = Controller[Any] | str | None
"""Controller as an object or by name, or None for the controller of the configuration."""
Observe: TypeAlias = Callable[[CycleRecord], object] | None
"""Callback that receives the record of each cycle."""


def load(
    config: Configuration = None,
    *,
    faults: Faults = (),
    controller: GivenController = None,
    seed: int | None = None,
) -> Config:
    """Load and validate the configuration of a run. The other functions of this module accept the result; given
    anything else, they call this function.

    `faults` are added after those of the configuration. `seed` determines every random draw in the emulated cell. File
    names in a TOML file are relative to its folder, those in a mapping to the working directory. Raises ConfigError
    with the invalid key.
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

    A `controller` object satisfies `Controller`: a pure control law, so that the same object can be used again.
    `observe` is called with the record of each cycle. If it raises an error, the run ends, the tool is retracted, and
    the error is raised here. No file is written; `Result.save` writes the recording.

    A run that the guard stops returns a `Result`, too. Raises ConfigError for a configuration that cannot be run, and
    for one with a real device; other BridgeErrors if a device fails before the movement has begun.
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
    """Run like `simulate`, but awaitable and in a separate thread, so that a notebook or a server is not blocked.

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
    """Open a run with access to its robot, sensor, clock, ground truth and panel while it runs, for `async with`.

    The run is a separate task, started by `Simulation.start`, `reached` or `finished`. On leaving the context, also by
    an exception, a run that is still active retracts and ends. Then `Simulation.result` is available.

    Under `run_virtual` the run uses virtual time, under `run_real` or any other event loop real time. In real time, a
    configuration may contain real devices; the recording is kept in memory. Arguments and errors are those of
    `simulate`.
    """
    return simulating(load(config, faults=faults, controller=controller, seed=seed), observe)


def open_devices(config: Configuration = None) -> AbstractAsyncContextManager[OpenDevices]:
    """Open and start robot and sensor without a run, for a script that controls a cell itself, for `async with`.

    A device without a URL is emulated. Exception: a real robot is opened without an emulated sensor, and access to the
    sensor raises ConfigError. No guard supervises such a script: the robot executes every order within its own limits.
    Leaving the context closes the devices. Raises ConfigError for a URL, for configured faults and for a real device in
    virtual time, TransportUnavailable for a wire.
    """
    return opening_devices(load(config))


def run_virtual(main: Main[T]) -> T:
    """Run a coroutine, or the coroutine that a function returns, in a new event loop in virtual time.

    If an event loop is already running, as in a notebook, it runs in another thread. Stricter than real time: raises
    LeakedTasks for tasks left behind, and VirtualDeadlock if nothing can happen any more. It also raises errors of
    callbacks, which real time would only log.
    """
    if not _in_loop():
        return _run_virtual(main)
    with ThreadPoolExecutor(1, "virtual time") as executor:
        return executor.submit(_run_virtual, main).result()


def run_real(main: Main[T], busy_poll_s: float = 0.0) -> T:
    """Run a coroutine, or the coroutine that a function returns, in real time; like `asyncio.run`.

    `busy_poll_s` is the time for which the loop polls before it sleeps, s. Raises ConfigError if an event loop is
    already running, as in a notebook: await the coroutine there.
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
