"""Data files named by the settings of a campaign: a policy, the rules of a fuzzy controller, or a height map.

A bundle contains these files, each named by the SHA-256 of its content. It never contains a plug-in controller,
because that is code.
"""

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from hil_bridge.control.controllers import OURS, controller_package
from hil_bridge.control.laws.policy import PolicyFile
from hil_bridge.errors import ConfigError
from hil_bridge.errors.text_files import format_path, open_ordinary
from hil_bridge.lab.campaign.judging import Job
from hil_bridge.lab.campaign.overlay import POLICY_FILE
from hil_bridge.lab.campaign.plan import Plan
from hil_bridge.lab.campaign.store import Done
from hil_bridge.settings.configuration import Config
from hil_bridge.settings.overrides import lay_over

KEYS = (POLICY_FILE, "controller.parameters.rules_file", "cell.surface.height_map_file")
"""Settings that name a data file."""
INPUTS = "inputs"
"""Folder of a bundle that contains these files, each named by the SHA-256 of its content."""
POLICY_RUNTIME = "onnxruntime"
"""Package that evaluates a policy file."""


def hash_file(path: Path) -> str:
    """Return the SHA-256 of a file. Raises ConfigError."""
    digest = hashlib.sha256()
    with open_ordinary(path) as file:
        while piece := file.read(1 << 20):
            digest.update(piece)
    return digest.hexdigest()


def pin_policy(config: Config) -> Config:
    """Add the SHA-256 of the policy file to a configuration, so that a file with different content makes a
    different plan.
    """
    section = config.controller
    if section.name != PolicyFile.name or section.parameters.get("sha256"):
        return config
    parameters = {**section.parameters, "sha256": hash_file(Path(section.parameters["file"]))}
    return config.model_copy(update={"controller": section.model_copy(update={"parameters": parameters})})


def pack_inputs(folder: Path, plan: Plan, runs: Iterable[Done]) -> dict[str, str]:
    """Copy the files that the runs of a campaign need into the folder `inputs` below `folder`.

    Returns their SHA-256, by the path in the settings. Raises ConfigError for a missing file.
    """
    packed: dict[str, str] = {}
    for config, table in dict.fromkeys((plan.cases[done.number].config, done.table) for done in runs):
        for path in _files_named(config, table):
            if path in packed:
                continue
            try:
                packed[path] = hash_file(Path(path))
            except ConfigError as error:
                raise ConfigError(f"{error}; settings of the campaign name this file, restore it") from error
            target = folder / INPUTS / packed[path]
            target.parent.mkdir(exist_ok=True)
            target.write_bytes(Path(path).read_bytes())
    return packed


def computing_packages(plan: Plan) -> list[str]:
    """Return the third-party packages that evaluate the controllers of a campaign."""
    names = {_text(json.loads(case.config), "controller.name") for case in plan.cases}
    packages = [POLICY_RUNTIME] if PolicyFile.name in names else []
    return packages + [controller_package(name).rpartition(" ")[0] for name in sorted(names - OURS.keys())]


def with_inputs(job: Job, folder: Path, packed: Mapping[str, str]) -> Job:
    """Return a job whose settings name the files of an unpacked bundle instead of the original paths.

    Raises ConfigError for a file that is not in the bundle. Files of this computer are never used instead.
    """
    values, over = json.loads(job.config), json.loads(job.table)
    laid: dict[str, Any] = over.get("config", {})
    named = [*_files_named(job.config, job.table)]
    for path in named:
        if path not in packed:
            raise ConfigError(f"{format_path(Path(path))} is not in the bundle; get the bundle again")
    for key in KEYS:
        if (path := _text(values, key)) in named:
            lay_over(values, {key: str(folder / INPUTS / packed[path])})
        if laid.get(key) in named:
            laid[key] = str(folder / INPUTS / packed[laid[key]])
    return replace(job, config=json.dumps(values), table=json.dumps(over)) if named else job


def _files_named(config: str, table: str) -> Iterator[str]:
    """Yield the data files that a configuration with the overlay `table` names; both arguments are JSON."""
    values = json.loads(config)
    lay_over(values, json.loads(table).get("config", {}))
    is_ours = _text(values, "controller.name") in OURS
    for key in KEYS:
        if (path := _text(values, key)) and (is_ours or not key.startswith("controller.")):
            yield path


def _text(values: Any, key: str) -> str:
    """Return the text at a dotted key; empty if there is no text."""
    for name in key.split("."):
        values = values.get(name) if isinstance(values, dict) else None
    return values if isinstance(values, str) else ""
