"""Configuration of each episode: a base configuration, with settings and faults drawn from a seed as in a campaign."""

import json
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

import msgspec

from hil_bridge.errors import ConfigError
from hil_bridge.lab.campaign.draw_file import draw_of, try_options
from hil_bridge.lab.campaign.drawing import EVERY, Draw, draw_values, numbers_of
from hil_bridge.lab.campaign.overlay import config_with
from hil_bridge.runs.faults.wrong_controller import CONTROLLER
from hil_bridge.settings.configuration import Config, dump
from hil_bridge.settings.given import Source, config_of
from hil_bridge.settings.overrides import lay_over

Tables: TypeAlias = Sequence[Mapping[str, Any]]
_CELL = "the environment"
_NOTHING = '{"config": {}, "faults": []}'


class Episodes(NamedTuple):
    """Configurations of episodes by seed."""

    base: str
    """Common configuration, as JSON."""
    draw: Draw | None
    """Settings and faults drawn for each episode; None if nothing is drawn."""

    def drawn(self, seed: int) -> str:
        """Return the settings and faults drawn for a seed, as JSON."""
        if self.draw is None:
            return _NOTHING
        numbers = numbers_of(f"{seed} {_CELL}", self.draw.dimensions)
        return draw_values(self.draw, _CELL, self.base, numbers)

    def drawn_values(self, seed: int) -> dict[str, Any]:
        """Return the settings drawn for a seed by dotted key, and the drawn faults as a list under `faults`."""
        drawn = json.loads(self.drawn(seed))
        return {**drawn["config"], "faults": drawn["faults"]}

    def config(self, seed: int) -> Config:
        """Return the configuration of an episode. Raises ConfigError for contradictory settings."""
        return config_with(self.base, self.drawn(seed), seed)


def plan_episodes(
    source: Source,
    over: Mapping[str, object],
    randomise: Mapping[str, Any],
    faults: Tables,
    faults_per_run: int | Mapping[str, int] | None,
) -> Episodes:
    """Plan the episodes of an environment.

    `over` contains settings by dotted key that override `source`. `randomise` has the format of [campaign.draw],
    and `faults` has the format of the [[campaign.fault]] tables of a campaign. `faults_per_run` is the number of
    faults per episode; None means one. Raises ConfigError.
    """
    values = config_of(source).model_dump(mode="json")
    lay_over(values, over)
    base = config_of(values, seed=0)
    for key, url in (("robot.url", base.robot.url), ("sensor.url", base.sensor.url)):
        if url:
            raise ConfigError(f"{key}: an environment runs on the emulated cell only; leave the URL empty")
    if base.task.step:
        raise ConfigError("task.step: an environment follows a surface without a program; remove the steps")
    if any(table.get("on") in (EVERY, CONTROLLER) for table in faults):
        raise ConfigError("faults: name the target; the controller of an environment is the policy")
    if faults_per_run is None:
        faults_per_run = 1 if faults else 0
    draw, problems = draw_of(
        {
            "draw": dict(randomise),
            "fault": [dict(table) for table in faults],
            "faults_per_run": faults_per_run,
        }
    )
    if problems:
        key, text = problems[0]
        raise ConfigError(f"{_name(key)} {text}")
    text = dump(base)
    if draw is not None:
        tried = try_options(draw, text)
        if tried.problems:
            raise ConfigError(f"randomise: {tried.problems[0]}")
        draw = msgspec.structs.replace(draw, without={_CELL: tried.impossible})
    return Episodes(text, draw)


def _name(key: str) -> str:
    """Translate a key of a campaign file to the corresponding argument of the environment."""
    for of_file, argument in (
        ("campaign.draw", "randomise"),
        ("campaign.faults_per_run", "faults_per_run"),
        ("campaign.fault", "faults"),
    ):
        if key.startswith(of_file):
            return argument + key.removeprefix(of_file)
    return key
