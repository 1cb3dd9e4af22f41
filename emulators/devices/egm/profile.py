"""Settings that may differ between guided robots, or are unknown.

Marks: statements of ABB's manual 3HAC073318-001 or of a public client are *observed*. Everything that these sources
leave open is *assumed*. Statements of the RAPID program are *chosen*: it is the program of `docs/reference/egm.md`.
"""

from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

from protocol.geometry import Vector
from protocol.marks import Mark, SettingError, above, at_least, between, check_settings, setting

_PerAxis = tuple[float, float, float, float, float, float]


@dataclass(frozen=True, slots=True)
class EgmArmProfile:
    """Dimensions of the arm, and its loops behind the controller's set point."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    natural_frequency_rad_s: float = setting(
        100.0,
        Mark.DERIVED,
        "natural frequency of the closed position loop; its lag is then 20 ms, of the 10 to 20 "
        "ms that ABB states. The faster pole of a ramp on ABB's virtual controller has 19 ms "
        "(hehonglu123/Motion-Primitive-Planning)",
        above(0.0),
        unit="rad/s",
    )
    damping_ratio: float = setting(1.0, Mark.ASSUMED, "damping ratio of the closed position loop", above(0.0))
    servo_delay_cycles: int = setting(
        1, Mark.ASSUMED, "delay from set point to position loop", between(1, 100), unit="cycles"
    )
    axis_2_height_mm: float = setting(
        445.0, Mark.CHOSEN, "distance from base to axis 2", above(0.0), unit="mm"
    )
    upper_arm_mm: float = setting(700.0, Mark.CHOSEN, "distance from axis 2 to axis 3", above(0.0), unit="mm")
    elbow_offset_mm: float = setting(
        115.0, Mark.CHOSEN, "distance from axis 3 to the forearm's axis", at_least(0.0), unit="mm"
    )
    forearm_mm: float = setting(795.0, Mark.CHOSEN, "distance from elbow to wrist", above(0.0), unit="mm")
    wrist_to_flange_mm: float = setting(
        85.0, Mark.CHOSEN, "distance from wrist to flange", at_least(0.0), unit="mm"
    )
    axis_ranges_deg: _PerAxis = setting(
        (180.0, 125.0, 127.5, 400.0, 120.0, 400.0),
        Mark.CHOSEN,
        "range of each axis to either side of its middle",
        above(0.0),
        unit="°",
    )
    axis_middles_deg: _PerAxis = setting(
        (0.0, 30.0, -52.5, 0.0, 0.0, 0.0), Mark.CHOSEN, "middle of each axis range", unit="°"
    )
    axis_3_against: Literal["horizon", "upper_arm"] = setting(
        "upper_arm", Mark.CHOSEN, "reference of the forearm's angle"
    )
    axis_speeds_deg_s: _PerAxis = setting(
        (175.0, 175.0, 175.0, 360.0, 360.0, 500.0),
        Mark.CHOSEN,
        "maximum speed of each axis",
        above(0.0),
        unit="°/s",
    )

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, slots=True)
class EgmProfile:
    """Controller, RAPID program and arm of an emulated robot."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    # --- the wire
    cycle_ms: float = setting(
        4.0,
        Mark.OBSERVED,
        "controller cycle; 4.032 ms on a real one",
        between(1.0, 100.0),
        unit="ms",
    )
    sample_ms: float = setting(
        4.0,
        Mark.CHOSEN,
        "SampleRate of the RAPID program: time between two datagrams",
        at_least(1.0),
        unit="ms",
    )
    rw: Literal["6.06", "6.10", "7"] = setting(
        "7", Mark.CHOSEN, "RobotWare version, which decides the fields of a datagram"
    )
    joints_in: Literal["degrees", "radians"] = setting(
        "degrees", Mark.OBSERVED, "unit of the reported joints: radians before RobotWare 6.07.01"
    )
    mode: Literal["pose", "joint", "path"] = setting(
        "pose",
        Mark.CHOSEN,
        "EGM mode: EGMActPose with EGMRunPose, EGMActJoint with EGMRunJoint, or EGMActMove with EGMMoveL",
    )
    send_when: Literal["run", "setup"] = setting(
        "run", Mark.ASSUMED, "when datagrams are sent: while EGMRun is active, or from EGMSetupUC on"
    )
    sends_stopped: bool = setting(
        True, Mark.ASSUMED, "whether datagrams continue while RAPID is stopped or the motors are off"
    )
    last_datagram: bool = setting(
        True, Mark.ASSUMED, "one more datagram reports the end of EGMRun if datagrams end with it"
    )
    measured_force: bool = setting(
        False, Mark.CHOSEN, "the robot has Force Control: its datagrams report the force of its own sensor"
    )
    force_noise_n: float = setting(0.2, Mark.ASSUMED, "noise of that force, rms", at_least(0.0), unit="N")
    force_offset_n: float = setting(
        4.5,
        Mark.ASSUMED,
        "largest offset of each axis of that force, drawn by the seed",
        between(0.0, 100.0),
        unit="N",
    )
    force_lag_ms: float = setting(
        10.0, Mark.ASSUMED, "time constant of that force's filter", between(0.0, 1000.0), unit="ms"
    )
    rx_queue: Literal["fifo", "latest"] = setting(
        "fifo", Mark.OBSERVED, "message that a cycle uses: the next in the queue, or the newest"
    )
    rx_queue_len: int = setting(
        64, Mark.ASSUMED, "length of the message queue; newer messages are lost", at_least(1)
    )
    seqno_check: Literal["ignore", "drop_old"] = setting(
        "ignore", Mark.ASSUMED, "a message whose sequence number does not increase is dropped"
    )
    bad_refreshes_timeout: bool = setting(
        False, Mark.ASSUMED, "an unusable message also restarts the time-out"
    )
    quat_tol: float = setting(
        0.01, Mark.ASSUMED, "tolerance of a quaternion's norm about 1", between(0.0, 1.0)
    )
    tm_start: int = setting(1000, Mark.ASSUMED, "controller clock at power-up", at_least(1), unit="ms")
    # --- the RAPID program and its errors
    comm_timeout_s: float = setting(
        1.0,
        Mark.ASSUMED,
        "CommTimeout: time without a message from the PC until an error",
        above(0.0),
        unit="s",
    )
    silence: Literal["error", "never"] = setting(
        "error",
        Mark.ASSUMED,
        "a missing message from the PC is an error; it was not on a GoFa with RobotWare 7.21",
    )
    retry_s: float = setting(
        2.0,
        Mark.CHOSEN,
        "time from a time-out until the program's error handler starts another session; 0: never",
        at_least(0.0),
        unit="s",
    )
    cond_time_s: float = setting(
        1e9,
        Mark.CHOSEN,
        "CondTime: EGMRun ends once the position has been within the window for this time; 1 s "
        "without the argument",
        at_least(0.0),
        unit="s",
    )
    conv_mm: float = setting(
        1.0, Mark.OBSERVED, "convergence window for positions, to either side", at_least(0.0), unit="mm"
    )
    conv_deg: float = setting(
        0.5, Mark.OBSERVED, "convergence window for angles, to either side", at_least(0.0), unit="°"
    )
    minmax_clamps: bool = setting(False, Mark.ASSUMED, "the window also limits the motion from the start")
    stop_mode: Literal["hold", "ramp_down"] = setting(
        "hold", Mark.CHOSEN, "end of EGMRun: EGM_STOP_HOLD, or EGM_STOP_RAMP_DOWN back to its start"
    )
    di_ends_run: bool = setting(
        True, Mark.CHOSEN, "whether RAPIDtoRobot.digVal is a condition that ends EGMRun (RobotWare 7)"
    )
    restart_after_motors_off: bool = setting(True, Mark.OBSERVED, "EGM resumes when the motors are on again")
    # --- the motion
    k: float = setting(5.0, Mark.OBSERVED, "proportional position gain", between(0.0, 20.0), unit="1/s")
    pos_corr_gain: float = setting(
        1.0, Mark.OBSERVED, "PosCorrGain: factor of k; 0 selects pure speed control", at_least(0.0)
    )
    lp_hz: float = setting(
        20.0, Mark.OBSERVED, "bandwidth of the low-pass filter; 0: no filter", between(0.0, 100.0), unit="Hz"
    )
    ramp_in_s: float = setting(
        0.5, Mark.ASSUMED, "RampInTime: time until a reference takes full effect", at_least(0.0), unit="s"
    )
    ramp_out_s: float = setting(
        0.5, Mark.ASSUMED, "RampOutTime: duration of the return in a RAMP_DOWN", at_least(0.0), unit="s"
    )
    stop_ramp_s: float = setting(
        0.5,
        Mark.OBSERVED,
        "default ramp time: time to standstill when RAPID is stopped",
        at_least(0.0),
        unit="s",
    )
    ref_delay_cycles: int = setting(
        4,
        Mark.DERIVED,
        "delay from the queue to the motion: part of the 19 ms of dead time, and of the 32 ms to "
        "the first visible motion, in the same recording",
        between(0, 100),
        unit="cycles",
    )
    speed_ref_sticky: bool = setting(
        False, Mark.ASSUMED, "a message without a speed leaves the previous speed in force"
    )
    max_tcp_mm_s: float = setting(
        250.0, Mark.ASSUMED, "limit of the speed of a pose's reference", above(0.0), unit="mm/s"
    )
    max_tcp_deg_s: float = setting(
        60.0, Mark.ASSUMED, "limit of the angular speed of a pose's reference", above(0.0), unit="°/s"
    )
    max_speed_dev_deg: float = setting(
        60.0,
        Mark.CHOSEN,
        "MaxSpeedDeviation: maximum speed of an axis in joint mode; 1 °/s without the argument",
        above(0.0),
        unit="°/s",
    )
    max_pos_dev_deg: float = setting(
        1000.0,
        Mark.OBSERVED,
        "MaxPosDeviation: maximum distance of an axis from its position at the start of EGMRun",
        above(0.0),
        unit="°",
    )
    workspace_min_mm: Vector = setting(
        (-1e5, -1e5, -1e5),
        Mark.CHOSEN,
        "lower corner of the box that the set point must not leave",
        unit="mm",
    )
    workspace_max_mm: Vector = setting((1e5, 1e5, 1e5), Mark.CHOSEN, "upper corner of that box", unit="mm")
    path_corr_mm_s: float = setting(
        20.0, Mark.ASSUMED, "maximum speed of a path correction", above(0.0), unit="mm/s"
    )
    path_mm: Vector = setting(
        (200.0, 0.0, 0.0), Mark.CHOSEN, "programmed path in mode path, relative to the start", unit="mm"
    )
    path_speed_mm_s: float = setting(
        20.0, Mark.CHOSEN, "speed along the programmed path", above(0.0), unit="mm/s"
    )
    arm: EgmArmProfile = field(default_factory=EgmArmProfile)

    def __post_init__(self) -> None:
        check_settings(self)
        parts = self.sample_ms / self.cycle_ms
        if abs(parts - round(parts)) > 1e-9:
            raise SettingError(
                "sample_ms", f"must be a multiple of cycle_ms ({self.cycle_ms:g}), got {self.sample_ms:g}"
            )
