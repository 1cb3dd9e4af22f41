"""A whole trial in real time, and the port of its device."""

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
from hil_bridge.lab.conform.trial import NOMINAL, Played, Trial, choose_scenarios, play
from hil_bridge.runs.compose import choose_port
from hil_bridge.settings.configuration import Config, load_config
from hil_bridge.settings.devices import robot_at, sensor_at

_BOUND_BY_CLIENT = "udp://"
"""The robot speaks first, to a port on which its client listens."""


def rules_of(kind: str) -> type[Rules] | type[SensorRules]:
    """Rules of a kind of robot or of sensor. Raises ConfigError for a kind that is none."""
    if kind in SENSORS.names:
        return SensorRules
    if kind not in ROBOTS.names:
        raise ConfigError(
            f"there is no robot or sensor {kind!r}; choose one of {', '.join([*ROBOTS.names, *SENSORS.names])}"
        )
    return Rules


def cell_of(kind: str, config: Path | Mapping[str, object] | None) -> Config:
    """The configuration of an emulated cell with this kind of device: a file's, or values by dotted key.

    Raises ConfigError.
    """
    thing = "sensor" if rules_of(kind) is SensorRules else "robot"
    given = {} if config is None or isinstance(config, Path) else dict(config)
    return load_config(config if isinstance(config, Path) else None, {**given, f"{thing}.emulated": kind})


def make_trial(
    config: Config, rules: Rules | SensorRules, command: Sequence[str], listen: str | None = None
) -> Trial[Any]:
    """The trial of a command by the rules of its device, which listens there. Raises ConfigError for a command that no
    port can be found for.
    """
    if isinstance(rules, SensorRules):
        url = listen or choose_port(sensor_at(config, ""), virtual=False).named_url
        return SensorTrial(config, url, rules, partial(ProcessClient, command))
    return RobotTrial(config, usual_port(config, listen, command), rules, partial(ProcessClient, command))


def usual_port(config: Config, listen: str | None, command: Sequence[str]) -> str:
    """URL on which the robot listens, where none is named: free ports where the client is told them.

    A client of a robot that speaks first listens itself. It is given a free port where its command has {port} or {url},
    and the robot's usual one elsewhere.
    """
    if listen is not None:
        return listen
    usual = choose_port(robot_at(config, ""), virtual=False)
    told = any("{port}" in word or "{url}" in word for word in command)
    if usual.url.startswith(_BOUND_BY_CLIENT) and told:
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
) -> Played[Any]:
    """Put a command through one scenario in real time: kind of device and scenario, words, settings, rules.

    Settings are a file's, or values by dotted key. Raises BridgeError, also ConfigError for a wrong name.
    """
    kind, scenario = what
    try:
        asked = rules_of(kind)(**rules)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"a rule: {error}; `hil-bridge conform {kind} --rules` lists them") from error
    trial = make_trial(cell_of(kind, config), asked, command)
    (name,) = choose_scenarios(trial, [scenario])
    return run_real(lambda: play(name, trial))


def play_all(trial: Trial[Any], names: Sequence[str], say: Callable[[str], None]) -> list[Played[Any]]:
    """Play these scenarios one after the other, in real time. Raises BridgeError, KeyboardInterrupt."""
    played: list[Played[Any]] = []
    for name in names:
        nominal = next((one for one in played if one.name == NOMINAL), None)
        if nominal is not None and (skipped := trial.refuse(name, nominal)) is not None:
            played.append(skipped)
            continue
        say(f"{name} …")
        played.append(run_real(lambda name=name: play(name, trial)))  # type: ignore[misc]
    return played
