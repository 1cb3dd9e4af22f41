"""Origin of a fact, kept next to the fact.

A *profile* is a frozen dataclass whose fields are made by `setting`. Each has a default, a mark that says how well the
default is known, and a sentence of meaning. `settings` lists them for people to read.
"""

import dataclasses
from collections.abc import Mapping
from enum import StrEnum
from typing import Any, NamedTuple


class Mark(StrEnum):
    """How well a value is known."""

    OBSERVED = "observed"
    """Read from a real device or from the only client known to have driven one."""
    DERIVED = "derived"
    """Follows from observed values by arithmetic or measurement."""
    STANDARD = "standard"
    """Links and devices of this kind do so."""
    ASSUMED = "assumed"
    """Unknown; correct it on site."""
    CHOSEN = "chosen"
    """A choice of this project or its user, not a fact about a device."""


@dataclasses.dataclass(frozen=True, slots=True)
class Bounds:
    """The numbers that a setting may have; None for no bound."""

    minimum: float | None = None
    """Inclusive, as `maximum`."""
    maximum: float | None = None
    above: float | None = None
    """Exclusive."""


ANY = Bounds()
"""Every number, and what is none."""


def at_least(minimum: float) -> Bounds:
    """Return bounds for this number or more."""
    return Bounds(minimum)


def between(minimum: float, maximum: float) -> Bounds:
    """From one number to the other, both included."""
    return Bounds(minimum, maximum)


def above(limit: float, maximum: float | None = None) -> Bounds:
    """More than this number, and no more than the other."""
    return Bounds(maximum=maximum, above=limit)


@dataclasses.dataclass(frozen=True, slots=True)
class SettingInfo:
    """Notes about a setting beside its default."""

    mark: Mark
    meaning: str
    unit: str = ""
    within: Bounds = ANY


@dataclasses.dataclass(frozen=True, slots=True)
class Setting:
    """One setting of a profile with its present value."""

    name: str
    value: object
    default: object
    info: SettingInfo


class Preset(NamedTuple):
    """Default of a setting that depends on another setting, such as the model."""

    value: object
    mark: Mark


def setting(default: Any, mark: Mark, meaning: str, within: Bounds = ANY, unit: str = "") -> Any:
    """Return a dataclass field with its mark."""
    info = SettingInfo(mark, meaning, unit, within)
    return dataclasses.field(default=default, metadata={"setting": info})


class SettingError(ValueError):
    """The value of one setting cannot be. Where the settings were read from a file, the file's key is named."""

    def __init__(self, setting: str, problem: str) -> None:
        """Report a `setting` by its name in the profile; `problem` is the rest of the sentence that begins with it."""
        super().__init__(setting, problem)
        self.setting, self.problem = setting, problem

    def __str__(self) -> str:
        return f"{self.setting} {self.problem}"


def check_settings(profile: Any) -> None:
    """Raise SettingError for the first setting that is out of its bounds; for `__post_init__`."""
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
    """Give each setting that is None its preset; for `__post_init__` of a profile whose `presets` tell them by name."""
    for name, preset in profile.presets.items():
        if getattr(profile, name) is None:
            object.__setattr__(profile, name, preset.value)


def settings(profile: Any) -> tuple[Setting, ...]:
    """Return the settings of a profile in order, with their values and marks; the `presets` of a profile come first."""
    presets: Mapping[str, Preset] = getattr(profile, "presets", {})
    rows = []
    for field in dataclasses.fields(profile):
        if "setting" in field.metadata:
            default, info = field.default, field.metadata["setting"]
            if preset := presets.get(field.name):
                default, info = preset.value, dataclasses.replace(info, mark=preset.mark)
            rows.append(Setting(field.name, getattr(profile, field.name), default, info))
    return tuple(rows)
