"""Settings of the emulated controller and its arm."""

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from protocol.marks import Mark, SettingError, above, at_least, between, check_settings, setting

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
    noise_um: float = setting(
        5.0, _A, "noise of the reported place, root mean square", at_least(0.0), unit="µm"
    )
    noise_urad: float = setting(5.0, _A, "the same of the orientation", at_least(0.0), unit="µrad")
    force_point: Literal["flange", "tcp"] = setting(
        "flange", _A, "point about which actual_TCP_force tells its moments; tcp on a CB3"
    )
    force_noise_n: float = setting(
        0.2, _A, "noise of the arm's own force sensor, root mean square", at_least(0.0), unit="N"
    )
    force_offset_n: float = setting(
        4.5,
        _O,
        "largest offset of each axis of actual_TCP_force, drawn by the seed; 28 of a CB3",
        between(0.0, 100.0),
        unit="N",
    )
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

    def __post_init__(self) -> None:
        check_settings(self)
        parts = self.version.split(".")
        if len(parts) != 4 or not all(part.isdecimal() and len(part) < 10 for part in parts):
            raise SettingError("version", f"must be four numbers with dots, got {self.version!r}")
        if not (self.serial_number.isascii() and self.serial_number.isdecimal()):
            raise SettingError("serial_number", f"must be digits, got {self.serial_number!r}")
