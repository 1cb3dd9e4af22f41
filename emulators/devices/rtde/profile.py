"""Settings of the emulated controller and its arm."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from emulators.devices.rtde.generations import PRESETS
from emulators.devices.rtde.urscript.table import E_SERIES
from protocol.arm_size import PerAxis
from protocol.geometry import Vector
from protocol.marks import (
    Mark,
    Preset,
    SettingError,
    above,
    at_least,
    between,
    check_settings,
    fill_presets,
    setting,
)

_A, _O, _C = Mark.ASSUMED, Mark.OBSERVED, Mark.CHOSEN


@dataclass(frozen=True, slots=True)
class RtdeProfile:
    """Settings of a controller of Universal Robots; what its maker does not publish is assumed."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    model: Literal["ur5e", "ur10e", "ur5", "ur10"] = setting(
        "ur10e", _C, "model of the arm; the default start of the cell is out of a ur5e's reach"
    )
    cycle_ms: float = setting(
        2.0,
        _O,
        "controller cycle: 2 on an e-Series, 8 on a CB3",
        between(1.0, 100.0),
        unit="ms",
    )
    version: str = setting("5.12.0.0", _A, "software version: major.minor.bugfix.build")
    serial_number: str = setting("20235500001", _C, "serial number that the dashboard reports")
    program_folder: str = setting(
        "",
        _C,
        "folder of stored programs, text in URScript: NAME.script is loaded as NAME.urp; empty: no programs",
    )
    program_servers: Literal["loopback", "any"] = setting(
        "loopback", _C, "servers to which a program may open a connection: on this computer, or any"
    )
    remote_control: bool = setting(True, _C, "the robot is in Remote Control at power-up")
    uptime_s: float = setting(
        100.0,
        _A,
        "controller clock when the cell is created; a client may wait for 40 s",
        at_least(0.0),
        unit="s",
    )
    start_delay_ms: float = setting(
        50.0, _A, "time from a program's last line until the program plays", between(0.0, 5000.0), unit="ms"
    )
    script_steps: int = setting(
        100_000,
        _A,
        "steps that a program's thread may execute in one cycle of 2 ms; more without waiting "
        "stop the program",
        between(100, 10_000_000),
    )
    power_s: float = setting(
        2.0, _A, "time from power on to idle, and time to release the brakes", at_least(0.0), unit="s"
    )
    unlock_s: float = setting(
        5.0, _O, "minimum time until a protective stop can be unlocked", between(0.0, 60.0), unit="s"
    )
    release_delay_s: float = setting(
        0.0,
        _A,
        "time for which the inputs of a disconnected client stay reserved",
        between(0.0, 60.0),
        unit="s",
    )
    bad_input: Literal["ignore", "close"] = setting(
        "ignore", _A, "reaction to a data packet with an invalid recipe or length"
    )
    max_clients: int = setting(
        0,
        _A,
        "simultaneous RTDE clients; the connection of a further one is closed; 0: up to 16",
        between(0, 16),
    )
    output_delay_cycles: int = setting(1, _A, "age of the state in a data packet, in cycles", between(0, 10))
    on_protective_stop: Literal["paused", "stopped"] = setting(
        "paused", _A, "state of the program after a protective stop"
    )
    servo_gain_scale: float = setting(
        1.0, _A, "stiffness of servoj's loop per unit of its gain", above(0.0), unit="1/s"
    )
    slider_slows_servo: bool = setting(True, _A, "the speed slider slows servoj down")
    stop_deceleration_rad_s2: float = setting(
        4.0, _A, "deceleration of a joint when a program stops or pauses", above(0.0), unit="rad/s²"
    )
    max_joint_speed_rad_s: float = setting(
        3.14, _A, "joint speed above which a protective stop occurs", above(0.0), unit="rad/s"
    )
    max_tcp_speed_mm_s: float = setting(
        1500.0, _A, "tool speed above which a protective stop occurs", above(0.0), unit="mm/s"
    )
    max_target_step_mm: float = setting(
        50.0,
        _A,
        "distance between two servo targets above which a protective stop occurs",
        above(0.0),
        unit="mm",
    )
    max_target_turn_rad: float = setting(
        0.3,
        _A,
        "rotation between two servo targets, and change of each joint, above which a protective stop occurs",
        above(0.0),
        unit="rad",
    )
    max_force_n: float = setting(
        250.0,
        _A,
        "external force set by a client above which a protective stop occurs. A contact causes "
        "none, so that no run relies on it",
        above(0.0),
        unit="N",
    )
    follow_delay_cycles: int = setting(
        1, _O, "cycles from a target in the outputs to the arm's motion; 0 to 2 on real ones", between(1, 10)
    )
    follow_error_urad: float = setting(
        80.0,
        _O,
        "servo error of a slowly moving joint, rms; 60 to 120 for a UR5e in lbusellato/CoLeCT, "
        "whose tool deviated by 0.04 to 0.06 mm",
        at_least(0.0),
        unit="µrad",
    )
    fast_follow_error_urad: float = setting(
        500.0,
        _O,
        "servo error at 1 rad/s, rms, interpolated linearly below; 200 to 700 for a UR10e in "
        "shamilmamedov/dynamic_calibration",
        at_least(0.0),
        unit="µrad",
    )
    follow_error_ms: float = setting(
        100.0,
        Mark.DERIVED,
        "correlation time of that error, and its decay time at standstill: in lbusellato/CoLeCT "
        "the correlation is 0.6 after 50 ms, and 0 after 100 ms",
        at_least(0.0),
        unit="ms",
    )
    slow_joint_mrad_s: float = setting(
        1.0,
        Mark.DERIVED,
        "joint speed below which that error, its rate of change and the noise of the speed "
        "decrease in proportion. In lbusellato/CoLeCT the error is complete at 1 to 3 mrad/s, "
        "and absent at 0.1",
        above(0.0),
        unit="mrad/s",
    )
    joint_noise_urad: float = setting(
        None,
        _O,
        "white noise of each reported joint, rms; the pose is computed from these. By the model: "
        "18 for an e-Series (15 to 24 in qblc7/bachelorproject), 15 for a CB3",
        at_least(0.0),
        unit="µrad",
    )
    joint_bits: int = setting(
        None,
        _O,
        "resolution of a reported joint: one turn over two to this power; 0: not quantized. By "
        "the model: 19 for an e-Series (qblc7/bachelorproject), 0 for a CB3",
        between(0, 32),
    )
    joint_speed_noise_mrad_s: float = setting(
        None,
        _O,
        "white noise of the speed of a moving joint, 0.8 to 1.4 in lbusellato/CoLeCT; a "
        "stationary one reports 0. With the servo error it gives the 1.3 to 2.4 of that recording",
        at_least(0.0),
        unit="mrad/s",
    )
    current_noise_a: PerAxis = setting(
        None,
        _O,
        "white noise of actual_current, which has zero mean here; from lbusellato/CoLeCT",
        at_least(0.0),
        unit="A",
    )
    accelerometer_noise_m_s2: Vector = setting(
        None,
        _O,
        "white noise of actual_tool_accelerometer; from lbusellato/CoLeCT",
        at_least(0.0),
        unit="m/s²",
    )
    force_point: Literal["flange", "tcp"] = setting(
        None,
        _O,
        "reference point of the moments in actual_TCP_force of the robot's own sensor; by the "
        "model: tcp on a CB3. Those of an external force refer to the tool",
    )
    force_noise_n: Vector = setting(
        None,
        _O,
        "white noise of each axis of actual_TCP_force of a stationary arm, rms. By the model: "
        "0.18, 0.15, 0.10 for an e-Series (charintorn/UR_RTDE_Force_Recorder), 0.5 for a CB3 "
        "(lucasgallegos/bagfiles)",
        at_least(0.0),
        unit="N",
    )
    force_noise_nm: Vector = setting(
        None,
        _O,
        "white noise of its moments: 0.0045, 0.0048, 0.0035 for an e-Series, 0.05 for a CB3",
        at_least(0.0),
        unit="N·m",
    )
    moving_force_noise_n: Vector = setting(
        None,
        _O,
        "white noise of its forces while the arm moves: 0.34, 0.20, 0.13 for an e-Series (lbusellato/CoLeCT)",
        at_least(0.0),
        unit="N",
    )
    moving_force_noise_nm: Vector = setting(
        None,
        _O,
        "white noise of its moments while the arm moves: 0.007, 0.015, 0.011 for an e-Series",
        at_least(0.0),
        unit="N·m",
    )
    force_walk_n: float = setting(
        None,
        _O,
        "random walk of the zero of each axis of actual_TCP_force, rms change in 10 s; means "
        "over 0.2 to 80 s in charintorn/UR_RTDE_Force_Recorder differ by 0.03 to 0.07",
        at_least(0.0),
        unit="N",
    )
    force_slope_n_min: float = setting(
        None,
        _O,
        "largest steady drift of that zero, drawn by the seed; from the same repository",
        at_least(0.0),
        unit="N/min",
    )
    force_offset_n: float = setting(
        None,
        _O,
        "largest offset of each axis of actual_TCP_force, drawn by the seed; by the model: 4.5, "
        "or 28 for a CB3",
        between(0.0, 100.0),
        unit="N",
    )
    force_offset_axes: Literal["base", "flange"] = setting(
        None,
        _O,
        "frame in which that offset is constant: it turns with the flange "
        "(Universal_Robots_ROS_Driver, issues 294, 512 and 617)",
    )
    zero_at_start: bool = setting(
        None, _O, "actual_TCP_force is zeroed when a program starts; by the model: not on a CB3"
    )
    force_warm_up_n: float = setting(
        0.0,
        _A,
        "largest change of each axis of that offset while the arm warms up, drawn by the seed; 4 "
        "for a stationary UR within five minutes (Universal_Robots_ROS_Driver, issue 633)",
        between(0.0, 100.0),
        unit="N",
    )
    force_warm_up_s: float = setting(
        100.0,
        Mark.DERIVED,
        "time constant of that change: 95 % of it occurs within those five minutes",
        above(0.0),
        unit="s",
    )
    force_creep_share: float = setting(
        0.0,
        _A,
        "fraction of a contact force that varies slowly (Universal_Robots_ROS_Driver, issue 670)",
        between(0.0, 1.0),
    )
    force_creep_s: float = setting(30.0, _A, "time constant of that variation", above(0.0), unit="s")
    force_lag_ms: float = setting(
        10.0, _A, "time constant of the filter of actual_TCP_force", between(0.0, 1000.0), unit="ms"
    )
    force_pose_error_n: tuple[float, float] = setting(
        (-1.05, 3.26),
        _O,
        "least and largest deviation of the contact force from the reported force, over the poses of "
        "the arm, at 10 N and more; less in proportion below. Observed: 8.95 to 13.26 N for 10 N in "
        "force mode (a UR5e, doi:10.3390/s26051709)",
        between(-9.0, 100.0),
        unit="N",
    )
    force_mode_gain_mm_s_n: float = setting(
        0.77,
        Mark.DERIVED,
        "force mode: speed along a compliant axis in contact per newton of force error, at a gain "
        "scaling of 1. From the lag, so that the axis accelerates as a mass of 65 kg without a "
        "contact (a UR10e, doi:10.5194/ms-13-361-2022)",
        above(0.0),
        unit="mm/s/N",
    )
    force_mode_turn_gain_rad_s_nm: float = setting(
        0.02,
        _A,
        "force mode: speed about a compliant axis per newton metre of moment error",
        above(0.0),
        unit="rad/s/(N·m)",
    )
    force_mode_lag_ms: float = setting(
        50.0,
        Mark.DERIVED,
        "time constant with which a compliant axis in contact reaches that speed; without a contact, "
        "its speed grows without a bound. From the speed of a UR10e after its impact (same source). "
        "0: it has that speed at once",
        between(0.0, 10_000.0),
        unit="ms",
    )
    force_mode_gain_scaling: float = setting(
        1.0, _A, "scaling of these gains when a program starts", between(0.0, 2.0)
    )
    force_mode_damping: float = setting(
        0.005,
        _A,
        "fraction of a compliant axis's speed that is lost in each cycle, when a program starts",
        between(0.0, 1.0),
    )
    force_mode_least_n: float = setting(
        1.0,
        _A,
        "force below which a compliant axis with a target of zero does not move; for moments a "
        "tenth of it in N·m",
        at_least(0.0),
        unit="N",
    )
    freedrive_least_n: float = setting(
        10.0,
        _A,
        "freedrive: force below which the arm does not move; for moments a tenth of it in N·m",
        at_least(0.0),
        unit="N",
    )
    freedrive_speed_mm_s: float = setting(
        250.0, _A, "freedrive: maximum speed along an axis", above(0.0), unit="mm/s"
    )
    freedrive_turn_rad_s: float = setting(
        1.0, _A, "freedrive: maximum speed about an axis", above(0.0), unit="rad/s"
    )
    tool_contact_n: float = setting(
        5.0, _A, "change of force that is detected as a contact of the tool", above(0.0), unit="N"
    )
    force_watchdog_hz: float = setting(
        10.0,
        _A,
        "lowest rate of external forces; below it the program pauses; 0: never",
        at_least(0.0),
        unit="Hz",
    )

    @property
    def presets(self) -> Mapping[str, Preset]:
        """Defaults that depend on the model."""
        return PRESETS[self.model]

    def __post_init__(self) -> None:
        fill_presets(self)
        check_settings(self)
        parts = self.version.split(".")
        if len(parts) != 4 or not all(part.isdecimal() and len(part) < 10 for part in parts):
            raise SettingError("version", f"must be four numbers with dots, got {self.version!r}")
        if self.model.endswith("e") and int(parts[0]) < E_SERIES:
            raise SettingError(
                "version", f"must be {E_SERIES}.0.0.0 or later for model {self.model}, got {self.version!r}"
            )
        if not (self.serial_number.isascii() and self.serial_number.isdecimal()):
            raise SettingError("serial_number", f"must be digits, got {self.serial_number!r}")
