"""Overlay of a case's configuration: one fault, or drawn settings and faults."""

import json
import math
from functools import lru_cache
from typing import Any

from hil_bridge.control import make_controller
from hil_bridge.control.laws.policy import PolicyFile
from hil_bridge.runs.faults.wrong_controller import CONTROLLER, CONTROLLER_FAULTS, LyingController
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.configuration import Config, read_config
from hil_bridge.settings.given import config_of
from hil_bridge.settings.overrides import lay_over

POLICY_FILE = "controller.parameters.file"
"""Setting that names the file of a policy."""


def config_with(config: str, table: str, seed: int) -> Config:
    """Return the configuration of a run from the configuration of its case (JSON), the overlay (JSON) and the seed.

    Raises ConfigError.
    """
    over: dict[str, Any] = json.loads(table)
    if "config" not in over:
        return config_of(_config(config), [over] if over else [], seed=seed)
    values = json.loads(config)
    if POLICY_FILE in over["config"] and values["controller"]["name"] == PolicyFile.name:
        values["controller"]["parameters"].pop("sha256", None)  # the hash of the case's own policy
    lay_over(values, over["config"])
    lies = [fault for fault in over["faults"] if fault["on"] == CONTROLLER]
    injected = [fault for fault in over["faults"] if fault["on"] != CONTROLLER]
    combined = config_of(values, injected, seed=seed)
    return with_lie(combined, lies[0]) if lies else combined


def with_lie(config: Config, fault: dict[str, Any]) -> Config:
    """Wrap the controller of a configuration in a faulty controller. Raises ConfigError, and ValueError for invalid
    values.
    """
    config = Setup(config).config
    chosen = config.controller
    honest: Any = make_controller(chosen.name, **chosen.parameters)
    parameters = dict(fault.get("with", {}))
    values, _ = CONTROLLER_FAULTS[fault["fault"]].values(fault["fault"], parameters, CONTROLLER)
    numbers = {key: float(value) for key, value in values.items()}
    sample_ms = chosen.sample_ms if chosen.sample_ms is not None else honest.sample_ms
    lasts = fault.get("for_s", math.inf)
    lying = LyingController(honest, fault["fault"], numbers, fault.get("after_s", 0.0), lasts, sample_ms)
    return config_of(config, controller=lying)


@lru_cache(maxsize=256)
def _config(text: str) -> Config:
    return read_config(json.loads(text))
