"""Descriptions of a configuration: a commented file with all settings, their JSON schema, and the settings with a
mark.
"""

import dataclasses
import inspect
import textwrap
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any, NamedTuple

from pydantic import BaseModel

from hil_bridge.errors.text_files import toml_pair, toml_value
from hil_bridge.record.field_docstrings import field_docstrings
from hil_bridge.settings.configuration import Config, with_all_kinds
from hil_bridge.settings.sections import is_section, items_of
from protocol.marks import Setting, settings

_TABLES = ("faults", "step")
"""Settings that are written as separate tables. An empty list of the same name would collide with them."""


def profile_rows(config: Config) -> Iterator[tuple[str, Setting]]:
    """Yield every setting that has a mark, with its dotted key."""
    for key, section in _sections("", config):
        if dataclasses.is_dataclass(section):
            for item in settings(section):
                yield f"{key}.{item.name}", item


def schema() -> dict[str, Any]:
    """Return the JSON schema of a configuration file with any built-in devices. Its descriptions include the marks."""
    config = with_all_kinds()
    result = type(config).model_json_schema()
    definitions = result["$defs"]
    for key, section in (("", config), *_sections("", config)):
        definition = definitions[type(section).__name__] if key else result
        comments = _comments(section.__class__)
        definition["additionalProperties"] = (
            False  # not every version of pydantic says so for a section of sections
        )
        for name, entry in definition["properties"].items():
            value = getattr(section, name)
            entry["description"] = comments.get(name) or inspect.getdoc(type(value))
            if entry.get("default", value) is None:  # one that depends on another setting
                entry["default"] = value
    return result


class SettingRow(NamedTuple):
    """Row of a table of settings."""

    section: str
    """Dotted key of the section; empty for the top level."""
    name: str
    type: str
    default: str
    """Default as TOML writes it; empty if there is no default."""
    meaning: str


def setting_rows() -> Iterator[SettingRow]:
    """Yield every setting of a configuration with any built-in devices, section by section."""
    config = with_all_kinds()
    definitions = schema()["$defs"]
    for key, section in (("", config), *_sections("", config)):
        described = definitions[type(section).__name__]["properties"] if key else schema()["properties"]
        for name, value in items_of(section):
            if not is_section(value):
                entry = described[name]
                default = "" if value is None or name in _TABLES else toml_value(value)
                yield SettingRow(key, name, _type(entry, definitions), default, entry.get("description", ""))


def _type(entry: Mapping[str, Any], definitions: Mapping[str, Any]) -> str:
    """Return a description of a setting's type."""
    if "$ref" in entry:
        return _type(definitions[entry["$ref"].rpartition("/")[2]], definitions)
    if "enum" in entry:
        return " or ".join(map(str, entry["enum"]))
    if "const" in entry:
        return str(entry["const"])
    if among := entry.get("anyOf") or entry.get("oneOf"):
        return " or ".join(
            dict.fromkeys(_type(one, definitions) for one in among if one.get("type") != "null")
        )
    return str(entry.get("type", "any"))


def commented_defaults() -> str:
    """Return a configuration file with every setting at its default and a comment above it.

    Sections of devices that the file does not use are comments. In these sections, lines with a setting begin with
    a # without a space, so that a line can be used after its # is removed.
    """
    lines = ["# Configuration of hil-bridge. Every setting is at its default; delete what you do not change."]
    config = Config()
    for key, section in (("", config), *_sections("", config)):
        lines += _lines(key, section)
    lines += ["", "# Sections of other devices: remove the # before a line to use it."]
    used = {key for key, _ in _sections("", config)}
    for key, section in _sections("", with_all_kinds()):
        if key not in used:
            lines += [f"#{line}" if line and line[0] != "#" else line for line in _lines(key, section)]
    return "\n".join(lines) + "\n"


def _lines(key: str, section: Any) -> list[str]:
    """Return the lines of a section, without its inner sections; empty if the section has no settings of its own."""
    comments = _comments(section.__class__)
    plain = [(name, value) for name, value in items_of(section) if not is_section(value)]
    if not plain:
        return []
    lines = ["", f"[{key}]"] if key else [""]
    for name, value in plain:
        lines += textwrap.wrap(comments.get(name, ""), 108, initial_indent="# ", subsequent_indent="# ")
        lines.append(f"# {name} =" if value is None or name in _TABLES else toml_pair(name, value))
    return lines


def _sections(key: str, section: object) -> Iterator[tuple[str, Any]]:
    """Yield the section itself, and then every inner section, with dotted keys."""
    if key:
        yield key, section
    for name, value in items_of(section):
        if is_section(value):
            yield from _sections(f"{key}.{name}" if key else name, value)


@cache
def _comments(cls: Any) -> dict[str, str]:
    """Return the text for each field of a section: the setting's meaning with unit and mark, or the docstring of
    the field.
    """
    comments = field_docstrings(cls)
    if issubclass(cls, BaseModel):
        return comments
    for field in dataclasses.fields(cls):
        if info := field.metadata.get("setting"):
            unit = f", {info.unit}" if info.unit else ""
            comments[field.name] = f"{info.meaning.rstrip('.')}{unit} [{info.mark}]"
    return comments
