"""A whole trial in real time, and the port of its robot."""

import socket
from collections.abc import Callable, Sequence
from dataclasses import replace

from hil_bridge.clock import run_real
from hil_bridge.lab.conform.judging import Outcome
from hil_bridge.lab.conform.scenarios import NOMINAL
from hil_bridge.lab.conform.stage import Played, Trial, play, refuse_scenario
from hil_bridge.runs.compose import choose_port
from hil_bridge.settings.configuration import Config
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
