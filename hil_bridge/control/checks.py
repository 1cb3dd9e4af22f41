"""Checks of parameter models, one line of text each."""

import math
from typing import Any

FORBID_EXTRA: dict[str, str] = {"extra": "forbid"}
"""Tells pydantic to refuse keys that no field has."""


class SettingError(ValueError):
    """The value of one setting cannot be."""

    def __init__(self, setting: str, problem: str) -> None:
        """`setting` is its key, `problem` the rest of the sentence."""
        super().__init__(setting, problem)
        self.setting, self.problem = setting, problem

    def __str__(self) -> str:
        return f"{self.setting} {self.problem}"


def check_reference(reference: float) -> None:
    """Raise ValueError for a desired force that is not a finite number above 0."""
    if not (math.isfinite(reference) and reference > 0):
        raise ValueError(f"the desired force must be above 0 N, got {reference}")


def require_above_zero(model: Any, *names: str) -> None:
    """Raise SettingError for the first of these attributes that is not a finite number above 0."""
    for name in names:
        value = getattr(model, name)
        if not (isinstance(value, (int, float)) and math.isfinite(value) and value > 0):
            raise SettingError(name, f"must be a number above 0, got {value}")


def require_not_negative(model: Any, *names: str) -> None:
    """Raise SettingError for the first of these attributes that is not a finite number of at least 0."""
    for name in names:
        value = getattr(model, name)
        if not (isinstance(value, (int, float)) and math.isfinite(value) and value >= 0):
            raise SettingError(name, f"must be a number of at least 0, got {value}")
