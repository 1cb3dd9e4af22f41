"""Files of data that the settings of a campaign name: a policy, the rules of a fuzzy controller, a map of heights.

A bundle holds them, each under the SHA-256 of its content. A controller of another package is a program, and no bundle
holds one.
"""

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from hil_bridge.control.controllers import OURS, controller_package
from hil_bridge.control.laws.policy import PolicyFile
from hil_bridge.errors import ConfigError
from hil_bridge.errors.text_files import format_path, open_ordinary, read_up_to
from hil_bridge.lab.campaign.judging import Job
from hil_bridge.lab.campaign.overlay import POLICY_FILE
from hil_bridge.lab.campaign.plan import Plan
from hil_bridge.lab.campaign.store import Done
from hil_bridge.settings.configuration import Config, lay_over

POLICY_HASH = "controller.parameters.sha256"
KEYS = (POLICY_FILE, "controller.parameters.rules_file", "cell.surface.height_map_file")
"""Settings that name a file of data."""
INPUTS = "inputs"
"""Folder of a bundle with these files, each under the SHA-256 of its content."""
INPUT_LIMIT_BYTES = 1 << 28
"""Longest file that is packed. Chosen: a policy is 1000 times shorter."""
POLICY_RUNTIME = "onnxruntime"
"""Package that computes a policy in a file."""


def hash_file(path: Path) -> str:
    """Return the SHA-256 of a file. Raises ConfigError."""
    digest = hashlib.sha256()
    with open_ordinary(path) as file:
        while piece := file.read(1 << 20):
            digest.update(piece)
    return digest.hexdigest()


def pin_policy(config: Config) -> Config:
    """The same with the SHA-256 of its policy: with another content it is another plan, and is refused."""
    section = config.controller
    if section.name != PolicyFile.name or section.parameters.get("sha256"):
        return config
    parameters = {**section.parameters, "sha256": hash_file(Path(section.parameters["file"]))}
    return config.model_copy(update={"controller": section.model_copy(update={"parameters": parameters})})


def files_named(config: str, table: str = "{}") -> dict[str, str]:
    """Files of data by the settings that name them, of a configuration and of what is laid over it, both as JSON.

    Raises ValueError for what is no configuration.
    """
    values = _laid(config, table)
    named = {key: _text(values, key) for key in KEYS}
    if _text(values, "controller.name") not in OURS:
        named = {key: path for key, path in named.items() if not key.startswith("controller.")}
    return {key: path for key, path in named.items() if path}


def pack_inputs(folder: Path, plan: Plan, runs: Iterable[Done]) -> dict[str, str]:
    """Copy the files that the runs of a campaign need into `inputs` of a folder; their SHA-256 by the path in the
    settings. Raises ConfigError for a file that is missing, or is not the one with which the campaign was run.
    """
    packed: dict[str, str] = {}
    for config, table in dict.fromkeys((plan.cases[done.number].config, done.table) for done in runs):
        for key, path in files_named(config, table).items():
            if path not in packed:
                packed[path] = _pack_one(folder / INPUTS, path)
            wanted = _text(json.loads(config), POLICY_HASH).lower() if key == POLICY_FILE else ""
            drawn = POLICY_FILE in json.loads(table).get("config", {})
            if wanted and not drawn and packed[path] != wanted:
                raise ConfigError(
                    f"{format_path(Path(path))} is not the file with which the campaign was run: its SHA-256 is "
                    f"{packed[path]}, and was {wanted}; put that one back, or run the campaign anew"
                )
    return packed


def computing_packages(plan: Plan) -> list[str]:
    """Return the packages beside this one that compute the controllers of a campaign."""
    names = {_text(_laid(case.config, "{}"), "controller.name") for case in plan.cases}
    packages = [POLICY_RUNTIME] if PolicyFile.name in names else []
    return packages + [controller_package(name).rpartition(" ")[0] for name in sorted(names - OURS.keys())]


def with_inputs(job: Job, folder: Path, packed: Mapping[str, str]) -> Job:
    """Return a job with the files of an unpacked bundle in place of those that its settings name.

    Raises ConfigError for a file that the bundle lacks: no file of this computer is taken for it.
    """
    places: dict[str, str] = {}
    for path in files_named(job.config, job.table).values():
        if path not in packed:
            raise ConfigError(f"{format_path(Path(path))} is not in the bundle; get the bundle anew")
        places[path] = str(folder / INPUTS / packed[path])
    if not places:
        return job
    values, over = json.loads(job.config), json.loads(job.table)
    laid: dict[str, Any] = over.get("config", {})
    for key in KEYS:
        if (path := _text(values, key)) in places:
            lay_over(values, {key: places[path]})
        if laid.get(key) in places:
            laid[key] = places[laid[key]]
    return replace(job, config=json.dumps(values), table=json.dumps(over))


def _laid(config: str, table: str) -> dict[str, Any]:
    values: Any = json.loads(config)
    over: Any = json.loads(table)
    if not isinstance(values, dict) or not isinstance(over, dict):
        raise ValueError("the settings are no table")
    lay_over(values, over.get("config", {}))
    return values


def _pack_one(folder: Path, path: str) -> str:
    try:
        with open_ordinary(Path(path)) as file:
            data = read_up_to(file, INPUT_LIMIT_BYTES + 1)
    except ConfigError as error:
        raise ConfigError(f"{error}; settings of the campaign name this file: put it back") from error
    if len(data) > INPUT_LIMIT_BYTES:
        raise ConfigError(
            f"{format_path(Path(path))} is longer than the {INPUT_LIMIT_BYTES} bytes that are packed"
        )
    digest = hashlib.sha256(data).hexdigest()
    folder.mkdir(exist_ok=True)
    (folder / digest).write_bytes(data)
    return digest


def _text(values: Any, key: str) -> str:
    """The text at a dotted key; empty where there is none."""
    for name in key.split("."):
        values = values.get(name) if isinstance(values, dict) else None
    return values if isinstance(values, str) else ""
