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
    """A controller of Universal Robots; what its maker does not publish is assumed."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    model: Literal["ur5e", "ur10e", "ur5", "ur10"] = setting(
        "ur10e", _C, "the arm; the cell's usual start is out of a ur5e's reach"
    )
    cycle_ms: float = setting(
        2.0,
        _O,
        "cycle of the controller: 2 of an e-Series, 8 of a CB3",
        between(1.0, 100.0),
        unit="ms",
    )
    version: str = setting("5.12.0.0", _A, "version of its software: major.minor.bugfix.build")
    serial_number: str = setting("20235500001", _C, "digits that the dashboard tells")
    program_folder: str = setting(
        "", _C, "folder of stored programs, text in URScript: NAME.script is loaded as NAME.urp; empty: none"
    )
    program_servers: Literal["loopback", "any"] = setting(
        "loopback", _C, "servers to which a program may open a connection: of this computer, or any"
    )
    remote_control: bool = setting(True, _C, "whether it stands in Remote Control at power-up")
    uptime_s: float = setting(
        100.0, _A, "its clock when the cell is made; a client may wait for 40 s", at_least(0.0), unit="s"
    )
    start_delay_ms: float = setting(
        50.0, _A, "from a program's last line until it plays", between(0.0, 5000.0), unit="ms"
    )
    script_steps: int = setting(
        100_000,
        _A,
        "steps of a program's thread in one cycle, for the 2 ms of it; more without waiting stop the program",
        between(100, 10_000_000),
    )
    power_s: float = setting(2.0, _A, "from power on to idle, and for the brakes", at_least(0.0), unit="s")
    unlock_s: float = setting(
        5.0, _O, "a protective stop is not unlocked earlier", between(0.0, 60.0), unit="s"
    )
    release_delay_s: float = setting(
        0.0, _A, "how long the inputs of a lost client stay in use", between(0.0, 60.0), unit="s"
    )
    bad_input: Literal["ignore", "close"] = setting(
        "ignore", _A, "what it does with a data packet of a wrong recipe or length"
    )
    max_clients: int = setting(
        0, _A, "clients of RTDE at a time; a further one is closed; 0: no limit but 16", between(0, 16)
    )
    output_delay_cycles: int = setting(1, _A, "age of the state in a data packet, in cycles", between(0, 10))
    on_protective_stop: Literal["paused", "stopped"] = setting(
        "paused", _A, "what becomes of the program in a protective stop"
    )
    servo_gain_scale: float = setting(
        1.0, _A, "servoj's gain, times this, is the stiffness of its loop", above(0.0), unit="1/s"
    )
    slider_slows_servo: bool = setting(True, _A, "whether the speed slider slows servoj down")
    stop_deceleration_rad_s2: float = setting(
        4.0, _A, "of a joint when a program stops or pauses", above(0.0), unit="rad/s²"
    )
    max_joint_speed_rad_s: float = setting(
        3.14, _A, "above, it makes a protective stop", above(0.0), unit="rad/s"
    )
    max_tcp_speed_mm_s: float = setting(
        1500.0, _A, "above, it makes a protective stop", above(0.0), unit="mm/s"
    )
    max_target_step_mm: float = setting(
        50.0, _A, "larger between two servo targets, it makes a protective stop", above(0.0), unit="mm"
    )
    max_target_turn_rad: float = setting(
        0.3, _A, "the same of their turn, and of each joint", above(0.0), unit="rad"
    )
    max_force_n: float = setting(
        250.0,
        _A,
        "of a force that a client gives; above, it makes a protective stop. A contact makes none, so that no run "
        "leans on it",
        above(0.0),
        unit="N",
    )
    follow_delay_cycles: int = setting(
        1, _O, "cycles from a target in the outputs to the arm; 0 to 2 of real ones", between(1, 10)
    )
    follow_error_urad: float = setting(
        80.0,
        _O,
        "what remains between a joint that moves slowly and its target, root mean square; 60 to 120 of a UR5e in "
        "lbusellato/CoLeCT, whose tool was 0.04 to 0.06 mm off",
        at_least(0.0),
        unit="µrad",
    )
    fast_follow_error_urad: float = setting(
        500.0,
        _O,
        "the same at 1 rad/s, and in proportion between; 200 to 700 of a UR10e in shamilmamedov/dynamic_calibration",
        at_least(0.0),
        unit="µrad",
    )
    follow_error_ms: float = setting(
        100.0,
        Mark.DERIVED,
        "time by which that error becomes another, or goes away at rest: in lbusellato/CoLeCT it is correlated by 0.6 "
        "after 50 ms, and no more after 100 ms",
        at_least(0.0),
        unit="ms",
    )
    slow_joint_mrad_s: float = setting(
        1.0,
        Mark.DERIVED,
        "a slower joint has less of that error, slower changes of it, and less noise of its speed, in proportion. In "
        "lbusellato/CoLeCT it is whole at 1 to 3 mrad/s, and none at 0.1",
        above(0.0),
        unit="mrad/s",
    )
    joint_noise_urad: float = setting(
        None,
        _O,
        "white noise of each joint that is told, root mean square; the pose is computed from these. By the model: 18 "
        "of an e-Series (15 to 24 in qblc7/bachelorproject), 15 of a CB3",
        at_least(0.0),
        unit="µrad",
    )
    joint_bits: int = setting(
        None,
        _O,
        "a joint is told in steps of a turn over two to this power; 0: none. By the model: 19 of an e-Series "
        "(qblc7/bachelorproject), 0 of a CB3",
        between(0, 32),
    )
    joint_speed_noise_mrad_s: float = setting(
        None,
        _O,
        "white noise of the speed of a joint that moves, 0.8 to 1.4 in lbusellato/CoLeCT; one at rest tells 0. With "
        "the error behind the target it gives the 1.3 to 2.4 of that recording",
        at_least(0.0),
        unit="mrad/s",
    )
    current_noise_a: PerAxis = setting(
        None,
        _O,
        "white noise of actual_current, which has no mean here; of lbusellato/CoLeCT",
        at_least(0.0),
        unit="A",
    )
    accelerometer_noise_m_s2: Vector = setting(
        None, _O, "white noise of actual_tool_accelerometer; of lbusellato/CoLeCT", at_least(0.0), unit="m/s²"
    )
    force_point: Literal["flange", "tcp"] = setting(
        None,
        _O,
        "point about which actual_TCP_force tells moments of the own sensor; by the model: tcp on a CB3. Those of an "
        "external force are about the tool",
    )
    force_noise_n: Vector = setting(
        None,
        _O,
        "white noise of each axis of actual_TCP_force at rest, root mean square. By the model: 0.18, 0.15, 0.10 of an "
        "e-Series (charintorn/UR_RTDE_Force_Recorder), 0.5 of a CB3 (lucasgallegos/bagfiles)",
        at_least(0.0),
        unit="N",
    )
    force_noise_nm: Vector = setting(
        None,
        _O,
        "the same of its moments: 0.0045, 0.0048, 0.0035 of an e-Series, 0.05 of a CB3",
        at_least(0.0),
        unit="N·m",
    )
    moving_force_noise_n: Vector = setting(
        None,
        _O,
        "the same while the arm moves: 0.34, 0.20, 0.13 of an e-Series (lbusellato/CoLeCT)",
        at_least(0.0),
        unit="N",
    )
    moving_force_noise_nm: Vector = setting(
        None, _O, "and of its moments: 0.007, 0.015, 0.011 of an e-Series", at_least(0.0), unit="N·m"
    )
    force_walk_n: float = setting(
        None,
        _O,
        "how far the zero of each axis of actual_TCP_force walks in 10 s, root mean square; means over 0.2 to 80 s in "
        "charintorn/UR_RTDE_Force_Recorder differ by 0.03 to 0.07",
        at_least(0.0),
        unit="N",
    )
    force_slope_n_min: float = setting(
        None,
        _O,
        "largest steady slope of that zero, drawn by the seed; of the same repository",
        at_least(0.0),
        unit="N/min",
    )
    force_offset_n: float = setting(
        None,
        _O,
        "largest offset of each axis of actual_TCP_force, drawn by the seed; by the model: 4.5, or 28 of a CB3",
        between(0.0, 100.0),
        unit="N",
    )
    force_offset_axes: Literal["base", "flange"] = setting(
        None,
        _O,
        "axes along which that offset stands still: it turns with the flange (Universal_Robots_ROS_Driver, issues 294, "
        "512 and 617)",
    )
    zero_at_start: bool = setting(
        None, _O, "whether actual_TCP_force is zeroed when a program starts; by the model: not of a CB3"
    )
    force_warm_up_n: float = setting(
        0.0,
        _A,
        "largest change of that offset, of each axis, while the arm warms up, drawn by the seed; 4 of a UR at rest "
        "within five minutes (Universal_Robots_ROS_Driver, issue 633)",
        between(0.0, 100.0),
        unit="N",
    )
    force_warm_up_s: float = setting(
        100.0,
        Mark.DERIVED,
        "time constant of that change: 95 % of it within those five minutes",
        above(0.0),
        unit="s",
    )
    force_creep_share: float = setting(
        0.0,
        _A,
        "share of a contact's force that comes and goes slowly (Universal_Robots_ROS_Driver, issue 670)",
        between(0.0, 1.0),
    )
    force_creep_s: float = setting(30.0, _A, "time constant of that", above(0.0), unit="s")
    force_lag_ms: float = setting(10.0, _A, "time constant of its filter", between(0.0, 1000.0), unit="ms")
    force_mode_gain_mm_s_n: float = setting(
        0.4,
        _A,
        "force mode: speed along a compliant axis for each newton that is missing, at a gain scaling of 1. Derived "
        "of the lag of the arm's own force: one of 50 kN/m is held with little overshoot, and made unstable by 7 times",
        above(0.0),
        unit="mm/s/N",
    )
    force_mode_turn_gain_rad_s_nm: float = setting(
        0.02, _A, "the same about an axis, for each newton metre", above(0.0), unit="rad/s/(N·m)"
    )
    force_mode_gain_scaling: float = setting(
        1.0, _A, "scaling of these gains when a program begins", between(0.0, 2.0)
    )
    force_mode_damping: float = setting(
        0.005,
        _A,
        "share of a compliant axis's speed that each cycle without a force takes away, when a program begins",
        between(0.0, 1.0),
    )
    force_mode_least_n: float = setting(
        1.0,
        _A,
        "a smaller force, or moment of a tenth of it in N·m, counts as none where none is wanted",
        at_least(0.0),
        unit="N",
    )
    freedrive_least_n: float = setting(
        10.0, _A, "freedrive: a smaller force, or moment of a tenth, moves nothing", at_least(0.0), unit="N"
    )
    freedrive_speed_mm_s: float = setting(
        250.0, _A, "freedrive: largest speed along an axis", above(0.0), unit="mm/s"
    )
    freedrive_turn_rad_s: float = setting(
        1.0, _A, "freedrive: largest speed about an axis", above(0.0), unit="rad/s"
    )
    tool_contact_n: float = setting(
        5.0, _A, "change of the force that counts as a contact of the tool", above(0.0), unit="N"
    )
    force_watchdog_hz: float = setting(
        10.0,
        _A,
        "the program pauses when external forces come more rarely; 0: never",
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
