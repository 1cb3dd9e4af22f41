"""A whole trial in real time, and the port of its robot."""

import socket
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from hil_bridge.clock import run_real
from hil_bridge.devices.kinds import ROBOTS
from hil_bridge.errors import ConfigError
from hil_bridge.lab.conform.client import ProcessClient
from hil_bridge.lab.conform.robots.judging import Outcome
from hil_bridge.lab.conform.robots.scenarios import NOMINAL, Rules
from hil_bridge.lab.conform.robots.stage import Played, Trial, choose_scenarios, play, refuse_scenario
from hil_bridge.runs.compose import choose_port
from hil_bridge.settings.configuration import Config, load_config
from hil_bridge.settings.devices import robot_at

_BOUND_BY_CLIENT = "udp://"
"""The robot speaks first, to a port on which its client listens."""


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
) -> Played:
    """Put a command through one scenario in real time: kind of robot and scenario, words, settings, rules.

    Settings are a file's, or values by dotted key. Raises BridgeError, also ConfigError for a wrong name.
    """
    kind, scenario = what
    ROBOTS.kind(kind)
    given = {} if config is None or isinstance(config, Path) else dict(config)
    found = load_config(config if isinstance(config, Path) else None, {**given, "robot.emulated": kind})
    try:
        asked = Rules(**rules)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"a rule: {error}; `hil-bridge conform {kind} --rules` lists them") from error
    trial = Trial(found, usual_port(found, None, command), asked, partial(ProcessClient, command))
    (name,) = choose_scenarios(trial, [scenario])
    return run_real(lambda: play(name, trial))


def play_all(trial: Trial, names: Sequence[str], say: Callable[[str], None]) -> list[Played]:
    """Play these scenarios one after the other, in real time. Raises BridgeError, KeyboardInterrupt."""
    played: list[Played] = []
    for name in names:
        nominal = next((one for one in played if one.name == NOMINAL), None)
        stuck = (
            nominal is not None
            and nominal.verdict.outcome is not Outcome.PASSED
            and nominal.seen.moved_at is None
        )
        if stuck and nominal is not None:
            played.append(refuse_scenario(name, nominal))
            continue
        say(f"{name} …")
        played.append(run_real(lambda name=name: play(name, trial)))  # type: ignore[misc]
    return played
