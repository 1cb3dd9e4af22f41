"""Settings of emulated sensors without errors, for tests that compare exactly."""

from typing import Any

SETTLED: dict[str, Any] = {"wander_n": 0.0, "creep_share": 0.0, "vibration_n": 0.0, "motion_n": 0.0}
"""Settings without errors except white noise."""
QUIET: dict[str, Any] = {"noise_n": 0.0, "noise_nm": 0.0, **SETTLED}
"""Settings without any error."""
