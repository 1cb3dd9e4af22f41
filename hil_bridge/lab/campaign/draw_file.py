"""Random draws in a campaign file: `[campaign.draw]`, `faults_per_run`, and faults with ranges."""

import json
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from hil_bridge.clock import VIRTUAL_EPOCH
from hil_bridge.errors import BridgeError
from hil_bridge.errors.text_files import format_value
from hil_bridge.lab.campaign.drawing import EVERY, Draw, Setting, between_of, possible_faults
from hil_bridge.lab.campaign.overlay import config_with
from hil_bridge.runs.checks import check
from hil_bridge.runs.compose import can_hold
from hil_bridge.runs.setup import Setup

MOST_FAULTS = 9
"""Maximum number of faults in a run. Chosen: a reader can still identify the fault that caused a failure."""
MOST_WEIGHT = 1000
"""Largest weight of an option in a list. Chosen: rarer options would not occur in an overnight campaign."""
_FAULT_KEYS = ("on", "fault", "phase", "after_s", "for_s", "when", "with", "together")
Problem = tuple[str, str]
"""Key with a problem, and the description of the problem."""


def draw_of(campaign: Mapping[str, Any]) -> tuple[Draw | None, list[Problem]]:
    """Return the draws of each run, or None if there are none, and every problem with the draws."""
    draw_table, count = campaign.get("draw", {}), campaign.get("faults_per_run", 0)
    if not draw_table and not count:
        return None, []
    problems: list[Problem] = []
    fewest, most = _counts(count, problems)
    if not isinstance(draw_table, dict):
        return None, [("campaign.draw", "must be a table of ranges and lists")]
    settings = tuple(_settings(draw_table, problems))
    faults = campaign.get("fault", []) if most else []
    if most and not (isinstance(faults, list) and faults and all(isinstance(one, dict) for one in faults)):
        problems.append(("campaign.fault", "must be tables [[campaign.fault]], from which faults are drawn"))
        faults = []
    for number, table in enumerate(faults):
        problems += [(f"campaign.fault.{number}", text) for text in _problems_of_fault(table)]
    return Draw(settings, tuple(faults), fewest, most), problems


class DrawCheck(NamedTuple):
    """Result of checking a draw in one cell."""

    impossible: tuple[tuple[str, int], ...]
    """Options that the cell does not support."""
    problems: tuple[str, ...]
    """Problems of the draw in this cell: a setting without a supported option, a range that is supported only in
    part, or a plan without a fault that the cell supports.
    """


def try_options(draw: Draw, config: str) -> DrawCheck:
    """Check every option of each setting, and the ends of each range, in a cell."""
    impossible: list[tuple[str, int]] = []
    problems: list[str] = []
    for setting in draw.settings:
        if setting.between is not None:
            ends = [_refusal(config, setting.values(number)) for number in (0.0, 1.0)]
            problems += [text for text in ends if text][:1]
            continue
        distinct = {json.dumps(one, sort_keys=True): one for one in setting.options}
        refusals = {text: _refusal(config, one) for text, one in distinct.items()}
        texts = [refusals[json.dumps(one, sort_keys=True)] for one in setting.options]
        if all(texts):
            problems.append(texts[0])
        impossible += [(setting.key, place) for place, text in enumerate(texts) if text]
    if draw.most:
        devices = json.loads(config)
        kinds = devices["robot"]["emulated"], devices["sensor"]["emulated"], devices["cell"]["surface_kind"]
        if not possible_faults(draw.text, *kinds):
            problems.append("this cell supports none of the faults of the plan")
    return DrawCheck(tuple(impossible), tuple(problems))


def _refusal(config: str, values: Mapping[str, Any]) -> str:
    """Return why a cell does not accept these values, by dotted key; empty if it does."""
    try:
        setup = Setup(config_with(config, json.dumps({"config": dict(values), "faults": []}), 0))
        check(setup, True, VIRTUAL_EPOCH)
        x, y, z = setup.config.cell.start_position_mm
        if not can_hold(setup, (x * 1e-3, y * 1e-3, z * 1e-3)):
            return "cell.start_quaternion: the robot cannot reach this orientation at the start position"
    except BridgeError as error:
        return error.without_source
    return ""


def _counts(value: object, problems: list[Problem]) -> tuple[int, int]:
    match value:
        case int(count) if type(count) is int and 0 <= count <= MOST_FAULTS:
            return count, count
        case {"from": int(low), "to": int(high), **rest} if not rest and 0 <= low <= high <= MOST_FAULTS:
            return low, high
    text = f"must be a number from 0 to {MOST_FAULTS}, or {{ from = 1, to = 3 }}, got {format_value(value)}"
    problems.append(("campaign.faults_per_run", text))
    return 0, 0


def _settings(table: Mapping[str, Any], problems: list[Problem], before: str = "") -> Iterator[Setting]:
    for name, value in table.items():
        key = f"{before}{name}"
        if isinstance(value, dict) and "from" not in value:
            yield from _settings(value, problems, f"{key}.")
            continue
        try:
            yield _setting(key, value)
        except ValueError as error:
            problems.append((f"campaign.draw.{key}", str(error)))


def _setting(key: str, value: object) -> Setting:
    if (between := between_of(value)) is not None:
        return Setting(key, between)
    if not isinstance(value, list) or not value:
        raise ValueError(f"must be a range or a list, got {format_value(value)}")
    options: list[dict[str, Any]] = []
    for one in value:
        option = dict(leaves(one)) if isinstance(one, dict) else {key: one}
        option.pop("label", None)
        weight = option.pop("weight", 1)
        if type(weight) is not int or not 1 <= weight <= MOST_WEIGHT:
            raise ValueError(
                f"weight must be a whole number from 1 to {MOST_WEIGHT}, got {format_value(weight)}"
            )
        if any(name == "run.seed" or name.startswith("faults") for name in option):
            raise ValueError("cannot be drawn here: faults and seeds have their own settings")
        options += [option] * weight
    return Setting(key, None, tuple(options))


def leaves(table: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the values of nested tables by dotted key."""
    for key, value in table.items():
        if isinstance(value, dict) and value:
            yield from leaves(value, f"{before}{key}.")
        else:
            yield before + key, value


def _problems_of_fault(table: Mapping[str, Any]) -> Iterator[str]:
    if unknown := [key for key in table if key not in _FAULT_KEYS]:
        yield f"has an unknown key {unknown[0]!r}; known: {', '.join(_FAULT_KEYS)}"
    if not all(isinstance(table.get(key), str) and table[key] for key in ("on", "fault")):
        yield f"needs `on` and `fault`, each a name, or {EVERY!r} for all"
    phases = table.get("phase", "")
    if not isinstance(phases, str) and not (
        isinstance(phases, list) and phases and all(isinstance(phase, str) for phase in phases)
    ):
        yield "phase must be a name or a list of names"
    together = table.get("together", [])
    if not isinstance(together, list) or not all(isinstance(other, dict) for other in together):
        yield "together must be a list of tables with `on`, `fault` and `with`"
        return
    for other in together:
        yield from (f"together: {text}" for text in _problems_of_fault(other))
        if EVERY in (other.get("on"), other.get("fault")):
            yield f"together: needs names, not {EVERY!r}"
    parameters = table.get("with", {})
    if not isinstance(parameters, dict):
        yield "with must be a table"
        return
    for key, value in {
        **parameters,
        **{name: table[name] for name in ("after_s", "for_s") if name in table},
    }.items():
        try:
            between_of(value)
        except ValueError as error:
            yield f"{key} {error}"
