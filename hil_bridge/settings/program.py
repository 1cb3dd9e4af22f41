"""Program of a configuration: steps from a separate file, and messages about invalid steps."""

import dataclasses
import difflib
import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from hil_bridge.control.steps.kinds import BUILT_IN, step_kind, step_words
from hil_bridge.control.steps.paths import Arc, Line, Polyline, Raster, Spiral
from hil_bridge.control.steps.repeat import Repeat
from hil_bridge.control.steps.seam import Criterion, StepLimits
from hil_bridge.errors import ConfigError, SettingRefused, StepError
from hil_bridge.errors.text_files import format_path, format_value, read_toml
from protocol.marks import SettingError


def _by_tag(key: str, *sections: Any) -> Mapping[str, type]:
    """Return classes of settings, by the value of the key that distinguishes the classes."""
    return {section.__dataclass_fields__[key].default: section for section in sections}


STEPS: Mapping[str, type] = {**BUILT_IN, "repeat": Repeat}
"""Settings of each built-in step, by its word."""
PATHS = _by_tag("kind", Line, Arc, Polyline, Raster, Spiral)
"""Settings of each kind of path, by its name."""
_SECTIONS: Mapping[str, type] = {"limits": StepLimits, "criterion": Criterion}
_KEY = "task.step"
_UNIT = "s|s2|ms|us|ns|m|mm|um|nm|n|kg|g|hz|rpm|rad|mrad|urad|deg|percent|share|counts"
_UNITS = re.compile(f"(?:{_UNIT})(?:_(?:{_UNIT}))*")
"""Unit at the end of a setting's name, for example `mm_s`."""
STEPS_HINT = f"; steps in a configuration are [[{_KEY}]], and a file of [[step]] alone is given with --task"
"""Advice for steps that are in the wrong table."""


def with_program(values: dict[str, Any], source: str) -> dict[str, Path]:
    """Add the steps and the frame from the file that `task.file` names to the values of a configuration.

    Returns the file by the keys that come from it. Raises ConfigError if the file cannot be read or holds anything
    else, or if `source` already has steps.
    """
    task = values.get("task")
    name = task.get("file") if isinstance(task, dict) else None
    if not isinstance(task, dict) or not isinstance(name, str) or not name:
        return {}
    path = Path(name)
    if task.get("step"):
        raise SettingRefused(
            source,
            (),
            f"both the steps [[task.step]] and the file {format_path(path)} are given: remove one of them",
        )
    read = read_toml(path)
    if unknown := [key for key in read if key not in ("step", "frame")]:
        raise ConfigError(
            f"{format_path(path)}: unknown key {unknown[0]}: the file of a program holds only [[step]] and [frame]"
        )
    if not read.get("step"):
        raise ConfigError(f"{format_path(path)}: no steps: give each as a table [[step]]")
    task["step"] = read["step"]
    sources = {_KEY: path}
    frame = read.get("frame", {})
    if not isinstance(frame, dict):
        raise ConfigError(
            f"{format_path(path)}: frame must be a table of settings, got {format_value(frame)}"
        )
    own = values.setdefault("frame", {})
    if not isinstance(own, dict):  # the configuration's own mistake
        return sources
    for key, value in frame.items():
        if own.get(key, value) != value:
            raise SettingRefused(
                source,
                ("frame", key),
                f"differs from that in {format_path(path)}: remove one of them",
                " ",
            )
        own[key] = value
        sources[f"frame.{key}"] = path
    return sources


def in_file(error: StepError, source: str, program: str) -> ConfigError:
    """Return the error with the file of the invalid step: `source`, or `program` if the steps have a separate file."""
    if program:
        return ConfigError(f"{program}: {error.in_table('step')}")
    return ConfigError(f"{source}: {error}") if source else error


def is_program(values: Mapping[str, Any]) -> bool:
    """Return whether the values come from a file that holds only the steps of a program."""
    return "step" in values and "task" not in values


def describe_problem(error: Mapping[str, Any]) -> tuple[str, str] | None:
    """Return location and text of pydantic's error in a step, for example "2 (track)"; None for an error outside
    the steps.
    """
    location = tuple(error["loc"])
    if location[:2] != ("task", "step"):
        return None
    if len(location) == 2:
        return "", f" must be tables [[{_KEY}]], got {format_value(error['input'])}"
    number, rest = f"{location[2] + 1}", location[3:]
    if rest[:2] == ("repeat", "step") and len(rest) > 2:
        number, rest = f"{number}.{rest[2] + 1}", rest[3:]
    word = rest[0] if rest else ""
    label = f" {number} ({word})" if word else f" {number}"
    keys, section = _keys(_kind(word), rest[1:])
    return label, _words(error, keys, section)


def first_problem(errors: Sequence[Mapping[str, Any]]) -> Mapping[str, Any]:
    """Return the error to report. A mistyped key takes precedence over the key that is missing because of it."""
    first = errors[0]
    siblings = [error for error in errors if error["loc"][:-1] == first["loc"][:-1]]
    mistyped = (error for error in siblings if error["type"] == "unexpected_keyword_argument")
    return next(mistyped, first) if first["type"] == "missing" else first


def count_problems(errors: Sequence[Mapping[str, Any]]) -> int:
    """Return the number of invalid settings. A force of a step that is neither a number nor a profile gives two
    errors.
    """
    return len({_place(error["loc"]) for error in errors})


def instead_of(names: Collection[str], wrong: str) -> str:
    """Return a suggestion of names for a mistyped name. A wrong unit suffix is identified as such."""
    stem = wrong.rsplit("_", 1)[0]
    longer = [name for name in names if name.startswith(f"{wrong}_")]
    same_stem = [name for name in names if name in longer or name.rsplit("_", 1)[0] == stem]
    units = [name for name in same_stem if _has_unit(name, wrong if name in longer else stem)]
    if units:
        return f"; the unit is part of the name: {' or '.join(units)}"
    if longer:
        return f"; did you mean {' or '.join(longer)}?"
    if close := difflib.get_close_matches(wrong, names, 1):
        return f"; did you mean {close[0]}?"
    return f"; known here: {', '.join(names)}"


def _has_unit(name: str, stem: str) -> bool:
    """Return whether a name consists of a stem and a unit."""
    return _UNITS.fullmatch(name.removeprefix(f"{stem}_")) is not None


def _kind(word: str | int) -> type | None:
    """Return the settings of a step by its word; None for an unknown word."""
    return STEPS.get(str(word)) or step_kind(str(word))


def _place(location: Sequence[str | int]) -> tuple[str | int, ...]:
    if location[:2] == ("task", "step") and "force_n" in location:
        return tuple(location[: location.index("force_n")])
    return tuple(location)


def _keys(section: type | None, rest: Sequence[str | int]) -> tuple[list[str], type | None]:
    """Return the keys below a step, as in its file, and the section of the last key."""
    keys: list[str] = []
    for part in rest:
        if isinstance(part, int) or keys == ["force_n"]:  # within a value
            break
        if keys == ["path"] and part in PATHS and section is not PATHS.get(part):
            section = PATHS[part]
            continue
        keys.append(part)
        section = _SECTIONS.get(part, section)
    return keys, section


def _words(error: Mapping[str, Any], keys: Sequence[str], section: type | None) -> str:
    """Return the text of an error, to follow the label of the step."""
    key, got = ".".join(keys), f", got {format_value(error['input'])}"
    begin = f": {key}" if key else ""
    match error["type"]:
        case "unexpected_keyword_argument":
            return f"{begin} is not a setting{instead_of(_names(section), keys[-1])}"
        case "value_error":
            cause = error["ctx"]["error"]
            return f"{begin}.{cause}" if begin and isinstance(cause, SettingError) else f"{begin}: {cause}"
        case "missing" if error["loc"][-1] == "step":
            return f"{begin} is missing: its steps are tables [[task.step.step]], in a separate file [[step.step]]"
        case "missing" if isinstance(error["loc"][-1], str):
            return f"{begin} is missing"
        case "missing":
            return f"{begin}: a value is missing{got}"
        case "union_tag_invalid":
            tag, known = _tags(keys)
            expected = error["ctx"]["expected_tags"]
            known = [word for word in known if f"'{word}'" in expected or word not in {*STEPS, *PATHS}]
            return f": {tag} must be one of {', '.join(known)}, got {format_value(error['ctx']['tag'])}"
        case "union_tag_not_found":
            tag, known = _tags(keys)
            return f": {tag} is missing: one of {', '.join(known)}"
        case kind if kind in ("model_attributes_type", "dataclass_type"):
            return f"{begin} must be a table of settings{got}"
        case _ if keys == ["force_n"]:
            return f"{begin} must be a force in N, or pairs of distance in mm and force in N{got}"
        case "tuple_type":
            return f"{begin} must be a list{got}"
        case "too_long":
            return f"{begin} must be x and y, two numbers in mm{got}"
        case "int_from_float":
            return f"{begin} must be a whole number{got}"
        case _:
            return f"{begin} {error['msg'].replace('Input should', 'must', 1)}{got}"


def _tags(keys: Sequence[str]) -> tuple[str, list[str]]:
    """Return the key of a step's word or a path's kind, and its allowed values."""
    return ("path.kind", list(PATHS)) if keys else ("do", [*step_words(), "repeat"])


def _names(section: type | None) -> list[str]:
    return [] if section is None else [field.name for field in dataclasses.fields(section)]
