"""Conformance tests in real time, and the ports of the devices under test."""

import socket
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from hil_bridge.clock import run_real
from hil_bridge.devices.kinds import ROBOTS, SENSORS
from hil_bridge.errors import ConfigError
from hil_bridge.lab.conform.client import ProcessClient
from hil_bridge.lab.conform.robots.scenarios import Rules
from hil_bridge.lab.conform.robots.stage import RobotTrial
from hil_bridge.lab.conform.sensors.scenarios import SensorRules
from hil_bridge.lab.conform.sensors.stage import SensorTrial
from hil_bridge.lab.conform.trial import NOMINAL, ScenarioResult, Trial, choose_scenarios, play
from hil_bridge.runs.compose import choose_port
from hil_bridge.settings.configuration import Config, load_config
from hil_bridge.settings.devices import robot_at, sensor_at

_BOUND_BY_CLIENT = "udp://"
"""URL scheme of robots that send first, to a port on which the client listens."""


def rules_of(kind: str) -> type[Rules] | type[SensorRules]:
    """Return the rules class for a robot or sensor kind. Raises ConfigError for an unknown kind."""
    if kind in SENSORS.names:
        return SensorRules
    if kind not in ROBOTS.names:
        raise ConfigError(
            f"unknown robot or sensor {kind!r}; known: {', '.join([*ROBOTS.names, *SENSORS.names])}"
        )
    return Rules


def cell_of(kind: str, config: Path | Mapping[str, object] | None) -> Config:
    """Return the configuration of an emulated cell with this kind of device. `config` is a file or contains values
    by dotted key.

    Raises ConfigError.
    """
    thing = "sensor" if rules_of(kind) is SensorRules else "robot"
    values = {} if config is None or isinstance(config, Path) else dict(config)
    return load_config(config if isinstance(config, Path) else None, {**values, f"{thing}.emulated": kind})


def make_trial(
    config: Config, rules: Rules | SensorRules, command: Sequence[str], listen: str | None = None
) -> Trial[Any]:
    """Create the conformance test of a command; `listen` is the URL of the device. Raises ConfigError if no port is
    available.
    """
    if isinstance(rules, SensorRules):
        url = listen or choose_port(sensor_at(config, ""), virtual=False).named_url
        return SensorTrial(config, url, rules, partial(ProcessClient, command))
    return RobotTrial(config, usual_port(config, listen, command), rules, partial(ProcessClient, command))


def usual_port(config: Config, listen: str | None, command: Sequence[str]) -> str:
    """Return the URL on which the robot listens. By default, its ports are free ports.

    If the robot sends first, its client listens: on a free port if the command of the client has {port} or {url},
    otherwise on the robot's usual port.
    """
    if listen is not None:
        return listen
    usual = choose_port(robot_at(config, ""), virtual=False)
    has_port = any("{port}" in word or "{url}" in word for word in command)
    if usual.url.startswith(_BOUND_BY_CLIENT) and has_port:
        host, _, _ = usual.url.removeprefix(_BOUND_BY_CLIENT).rpartition(":")
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind((host, 0))
            return replace(usual, url=f"{_BOUND_BY_CLIENT}{host}:{probe.getsockname()[1]}").named_url
    return usual.named_url


def play_once(
    what: tuple[str, str],
    command: Sequence[str],
    config: Path | Mapping[str, object] | None,
    rules: Mapping[str, Any],
) -> ScenarioResult[Any]:
    """Run one scenario with a command in real time. `what` contains the kind of the device and the name of the
    scenario.

    Settings come from a file, or are given as values by dotted key. Raises BridgeError, and ConfigError for a wrong
    name.
    """
    kind, scenario = what
    try:
        chosen = rules_of(kind)(**rules)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"a rule: {error}; `hil-bridge conform {kind} --rules` lists them") from error
    trial = make_trial(cell_of(kind, config), chosen, command)
    (name,) = choose_scenarios(trial, [scenario])
    return run_real(lambda: play(name, trial))


def play_all(
    trial: Trial[Any], names: Sequence[str], report: Callable[[str], None]
) -> list[ScenarioResult[Any]]:
    """Run scenarios one after the other in real time. Raises BridgeError, and KeyboardInterrupt on Ctrl-C."""
    results: list[ScenarioResult[Any]] = []
    for name in names:
        nominal = next((one for one in results if one.name == NOMINAL), None)
        if nominal is not None and (skipped := trial.refuse(name, nominal)) is not None:
            results.append(skipped)
            continue
        report(f"{name} …")
        results.append(run_real(lambda name=name: play(name, trial)))  # type: ignore[misc]
    return results
