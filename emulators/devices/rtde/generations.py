"""Differences between the two generations of Universal Robots' arms that their outputs show.

Observed for an e-Series in third-party recordings of real arms. Their repositories are lbusellato/CoLeCT (a UR5e),
shamilmamedov/dynamic_calibration (a UR10e), charintorn/UR_RTDE_Force_Recorder (forces) and qblc7/bachelorproject
(stationary joints). For a CB3: lucasgallegos/bagfiles (forces of a UR3) and mariogtz55/UR_RTDE_Databse (poses).
"""

from collections.abc import Mapping

from protocol.marks import Mark, Preset

_A, _O = Mark.ASSUMED, Mark.OBSERVED

_CURRENTS_A = (0.06, 0.06, 0.064, 0.014, 0.007, 0.023)
_ACCELERATIONS = (0.17, 0.12, 0.12)
_E_SERIES: Mapping[str, Preset] = {
    "joint_noise_urad": Preset(18.0, _O),
    "joint_bits": Preset(19, _O),
    "joint_speed_noise_mrad_s": Preset(0.9, _O),
    "current_noise_a": Preset(_CURRENTS_A, _O),
    "accelerometer_noise_m_s2": Preset(_ACCELERATIONS, _O),
    "force_point": Preset("flange", _O),
    "force_noise_n": Preset((0.18, 0.15, 0.10), _O),
    "force_noise_nm": Preset((0.0045, 0.0048, 0.0035), _O),
    "moving_force_noise_n": Preset((0.34, 0.20, 0.13), _O),
    "moving_force_noise_nm": Preset((0.007, 0.015, 0.011), _O),
    "force_walk_n": Preset(0.05, _O),
    "force_slope_n_min": Preset(0.08, _O),
    "force_offset_n": Preset(4.5, _O),
    "force_offset_axes": Preset("flange", _O),
    "zero_at_start": Preset(True, _O),
}
_CB3: Mapping[str, Preset] = {
    "joint_noise_urad": Preset(15.0, Mark.DERIVED),  # from a pose whose orientation varies by 23 to 30 µrad
    "joint_bits": Preset(0, _A),
    "joint_speed_noise_mrad_s": Preset(0.9, _A),
    "current_noise_a": Preset(_CURRENTS_A, _A),
    "accelerometer_noise_m_s2": Preset(_ACCELERATIONS, _A),
    "force_point": Preset("tcp", _O),
    "force_noise_n": Preset((0.5, 0.5, 0.5), _O),
    "force_noise_nm": Preset((0.05, 0.05, 0.05), _O),
    "moving_force_noise_n": Preset((0.5, 0.5, 0.5), _A),
    "moving_force_noise_nm": Preset((0.05, 0.05, 0.05), _A),
    "force_walk_n": Preset(0.05, _A),
    "force_slope_n_min": Preset(0.08, _A),
    "force_offset_n": Preset(28.0, _O),
    "force_offset_axes": Preset("flange", _A),
    "zero_at_start": Preset(False, _A),
}
PRESETS: Mapping[str, Mapping[str, Preset]] = {
    "ur5e": _E_SERIES,
    "ur10e": _E_SERIES,
    "ur5": _CB3,
    "ur10": _CB3,
}
"""Defaults of settings, by the model of the arm."""
