"""Origin of a fact, kept next to the fact.

A *profile* is a frozen dataclass whose fields are made by `setting`. Each has a default, a mark that says how well the
default is known, and a sentence of meaning. `settings` lists them for people to read.
"""

import dataclasses
from enum import StrEnum
from typing import Any


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
class SettingInfo:
    """Notes about a setting beside its default."""

    mark: Mark
    meaning: str
    unit: str = ""
    minimum: float | None = None
    maximum: float | None = None
    above: float | None = None


@dataclasses.dataclass(frozen=True, slots=True)
class Setting:
    """One setting of a profile with its present value."""

    name: str
    value: object
    default: object
    info: SettingInfo


def setting(
    default: Any,
    mark: Mark,
    meaning: str,
    *,
    unit: str = "",
    minimum: float | None = None,
    maximum: float | None = None,
    above: float | None = None,
) -> Any:
    """A dataclass field with its mark. `above` is an exclusive lower bound, the others are inclusive."""
    info = SettingInfo(mark, meaning, unit, minimum, maximum, above)
    return dataclasses.field(default=default, metadata={"setting": info})


def check_settings(profile: Any) -> None:
    """Raise ValueError naming the first setting that is out of its bounds; for `__post_init__`."""
    for item in settings(profile):
        value, info = item.value, item.info
        for number in value if isinstance(value, tuple) else (value,):
            if isinstance(number, bool) or not isinstance(number, (int, float)):
                continue
            if number != number:
                raise ValueError(f"{item.name} must be a number, got {number}")
            if info.above is not None and not number > info.above:
                raise ValueError(f"{item.name} must be more than {info.above:g}, got {number:g}")
            if info.minimum is not None and number < info.minimum:
                raise ValueError(f"{item.name} must be at least {info.minimum:g}, got {number:g}")
            if info.maximum is not None and number > info.maximum:
                raise ValueError(f"{item.name} must be at most {info.maximum:g}, got {number:g}")


def settings(profile: Any) -> tuple[Setting, ...]:
    """The settings of a profile in order, with their values and marks."""
    return tuple(
        Setting(field.name, getattr(profile, field.name), field.default, field.metadata["setting"])
        for field in dataclasses.fields(profile)
        if "setting" in field.metadata
    )
