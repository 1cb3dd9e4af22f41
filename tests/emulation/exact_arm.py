"""Settings of an emulated Universal Robot without any noise, offset or error, for tests that want exact figures."""

from typing import Any

from emulators.devices.rtde import RtdeProfile

NO_ERROR: dict[str, Any] = {
    "follow_error_urad": 0.0,
    "fast_follow_error_urad": 0.0,
    "joint_noise_urad": 0.0,
    "joint_bits": 0,
    "joint_speed_noise_mrad_s": 0.0,
    "force_noise_n": (0.0,) * 3,
    "force_noise_nm": (0.0,) * 3,
    "moving_force_noise_n": (0.0,) * 3,
    "moving_force_noise_nm": (0.0,) * 3,
    "force_walk_n": 0.0,
    "force_slope_n_min": 0.0,
    "force_offset_n": 0.0,
    "force_pose_error_n": (0.0, 0.0),
}
"""Settings of `[cell.rtde]` without errors."""


def exact_profile(**settings: Any) -> RtdeProfile:
    """Return a profile without errors, with these settings."""
    return RtdeProfile(**{**NO_ERROR, **settings})


EXACT = exact_profile()
