"""Checks of parameter models, with error messages of one line each."""

import math
from typing import Any

from protocol.marks import SettingError

FORBID_EXTRA: dict[str, str] = {"extra": "forbid"}
"""Pydantic configuration that rejects unknown keys."""


def check_reference(reference: float) -> None:
    """Raise ValueError if the desired force is not a finite number above 0."""
    if not (math.isfinite(reference) and reference > 0.0):
        raise ValueError(f"the desired force must be above 0 N, got {reference}")


def require_above_zero(model: Any, *names: str) -> None:
    """Raise SettingError for the first of the given attributes that is not a finite number above 0."""
    for name in names:
        value = getattr(model, name)
        if not (isinstance(value, (int, float)) and math.isfinite(value) and value > 0):
            raise SettingError(name, f"must be a number above 0, got {value}")


def require_not_negative(model: Any, *names: str) -> None:
    """Raise SettingError for the first of the given attributes that is not a finite number of at least 0."""
    for name in names:
        value = getattr(model, name)
        if not (isinstance(value, (int, float)) and math.isfinite(value) and value >= 0):
            raise SettingError(name, f"must be a number of at least 0, got {value}")


def require_shares_and_slope(model: Any) -> None:
    """Raise SettingError if a share of an estimator of the normal is above 1, or its steepest angle is 90° or more."""
    for name in ("learning_share", "smoothing_share"):
        if getattr(model, name) > 1.0:
            raise SettingError(name, f"must be at most 1, got {getattr(model, name)}")
    if model.steepest_deg >= 90.0:
        raise SettingError("steepest_deg", f"must be below 90, got {model.steepest_deg}")
