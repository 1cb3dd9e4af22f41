"""Marks that state how well each fact is known, stored together with the fact.

A *profile* is a frozen dataclass whose fields are created by `setting`. Each field has a default, a mark that says
how well the default is known, and a description. `settings` lists them for display.
"""

import dataclasses
from collections.abc import Mapping
from enum import StrEnum
from typing import Any, NamedTuple


class Mark(StrEnum):
    """Statement of how well a value is known."""

    OBSERVED = "observed"
    """Observed on a real device, or in the only client known to have controlled one."""
    DERIVED = "derived"
    """Derived from observed values by arithmetic or measurement."""
    STANDARD = "standard"
    """Common practice for links and devices of this kind."""
    ASSUMED = "assumed"
    """Unknown. The value must be corrected on site."""
    CHOSEN = "chosen"
    """Choice of this project or its user, not a property of a device."""


@dataclasses.dataclass(frozen=True, slots=True)
class Bounds:
    """Allowed values of a numeric setting. None means no limit."""

    minimum: float | None = None
    """Smallest allowed value. Like `maximum`, it is itself allowed."""
    maximum: float | None = None
    above: float | None = None
    """Lower limit that is not itself allowed."""


ANY = Bounds()
"""Bounds without limits. They also allow non-numeric values."""


def at_least(minimum: float) -> Bounds:
    """Return bounds that allow this number and any larger one."""
    return Bounds(minimum)


def between(minimum: float, maximum: float) -> Bounds:
    """Return bounds that allow the numbers between these two, including both."""
    return Bounds(minimum, maximum)


def above(limit: float, maximum: float | None = None) -> Bounds:
    """Return bounds that allow numbers greater than `limit` and, if `maximum` is given, at most `maximum`."""
    return Bounds(maximum=maximum, above=limit)


@dataclasses.dataclass(frozen=True, slots=True)
class SettingInfo:
    """Properties of a setting in addition to its default."""

    mark: Mark
    meaning: str
    unit: str = ""
    within: Bounds = ANY


@dataclasses.dataclass(frozen=True, slots=True)
class Setting:
    """One setting of a profile with its current value."""

    name: str
    value: object
    default: object
    info: SettingInfo


class Preset(NamedTuple):
    """Default of a setting that depends on another setting, such as the model."""

    value: object
    mark: Mark


def setting(default: Any, mark: Mark, meaning: str, within: Bounds = ANY, unit: str = "") -> Any:
    """Create a dataclass field for a setting with its mark."""
    info = SettingInfo(mark, meaning, unit, within)
    return dataclasses.field(default=default, metadata={"setting": info})


class SettingError(ValueError):
    """Invalid value of a setting. For a setting read from a file, the message names the key in the file."""

    def __init__(self, setting: str, problem: str) -> None:
        """Create an error. `setting` is the name in the profile; `problem` completes the sentence that starts with
        this name.
        """
        super().__init__(setting, problem)
        self.setting, self.problem = setting, problem

    def __str__(self) -> str:
        return f"{self.setting} {self.problem}"


def check_settings(profile: Any) -> None:
    """Raise SettingError for the first setting that is outside its bounds. Call it in `__post_init__`."""
    for item in settings(profile):
        value, bounds = item.value, item.info.within
        for number in value if isinstance(value, tuple) else (value,):
            if isinstance(number, bool) or not isinstance(number, (int, float)):
                continue
            if number != number:
                raise SettingError(item.name, f"must be a number, got {number}")
            if bounds.above is not None and not number > bounds.above:
                raise SettingError(item.name, f"must be more than {bounds.above:g}, got {number:g}")
            if bounds.minimum is not None and number < bounds.minimum:
                raise SettingError(item.name, f"must be at least {bounds.minimum:g}, got {number:g}")
            if bounds.maximum is not None and number > bounds.maximum:
                raise SettingError(item.name, f"must be at most {bounds.maximum:g}, got {number:g}")


def fill_presets(profile: Any) -> None:
    """Replace each setting that is None by its preset. Call it in `__post_init__` of a profile whose `presets` maps
    names to presets.
    """
    for name, preset in profile.presets.items():
        if getattr(profile, name) is None:
            object.__setattr__(profile, name, preset.value)


def settings(profile: Any) -> tuple[Setting, ...]:
    """Return the settings of a profile in order, with their values, defaults and marks. Defaults and marks in
    `presets` take precedence.
    """
    presets: Mapping[str, Preset] = getattr(profile, "presets", {})
    rows = []
    for field in dataclasses.fields(profile):
        if "setting" in field.metadata:
            default, info = field.default, field.metadata["setting"]
            if preset := presets.get(field.name):
                default, info = preset.value, dataclasses.replace(info, mark=preset.mark)
            rows.append(Setting(field.name, getattr(profile, field.name), default, info))
    return tuple(rows)
