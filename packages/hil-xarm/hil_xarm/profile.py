"""Settings of the emulated control box, its arm and its force sensor: section `[cell.xarm]`."""

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from emulators.sensing import settings as errors
from emulators.sensing.settings import PerAxis, SensorErrorSettings, check_errors
from protocol.geometry import Vector
from protocol.marks import Mark, SettingError, above, at_least, between, check_settings, setting


@dataclass(frozen=True, slots=True)
class XarmProfile(SensorErrorSettings):
    """Settings of an emulated control box with an xArm 6."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    # --- control box
    firmware: str = setting("2.5.0", Mark.CHOSEN, "version of the firmware, as MAJOR.MINOR.PATCH")
    arm_serial: str = setting("XI0000EMULATED", Mark.CHOSEN, "serial number of the arm")
    box_serial: str = setting("AC0000EMULATED", Mark.CHOSEN, "serial number of the control box")
    clients: int = setting(
        8, Mark.ASSUMED, "connections to one port at a time; further ones are closed", at_least(1)
    )
    answer_ms: float = setting(
        0.3, Mark.ASSUMED, "time until a command is answered", between(0.0, 1000.0), unit="ms"
    )
    real_ms: float = setting(10.0, Mark.OBSERVED, "period of port 30003", between(2.0, 1000.0), unit="ms")
    normal_ms: float = setting(100.0, Mark.ASSUMED, "period of port 30001", between(2.0, 1000.0), unit="ms")
    rich_ms: float = setting(200.0, Mark.OBSERVED, "period of port 30002", between(2.0, 1000.0), unit="ms")
    rt_ms: float = setting(10.0, Mark.ASSUMED, "period of port 30000", between(2.0, 1000.0), unit="ms")
    # --- servo mode
    control_ms: float = setting(
        4.0,
        Mark.OBSERVED,
        "control cycle: of several servo commands in one, only the newest counts",
        between(1.0, 100.0),
        unit="ms",
    )
    joint_speed_deg_s: float = setting(
        180.0, Mark.OBSERVED, "speed at which a joint runs to its target", above(0.0), unit="°/s"
    )
    joint_acceleration_deg_s2: float = setting(
        1146.0,
        Mark.DERIVED,
        "acceleration of a joint: 20 rad/s² of the maker's client",
        above(0.0),
        unit="°/s²",
    )
    tool_speed_mm_s: float = setting(
        1000.0,
        Mark.OBSERVED,
        "speed of the tool beyond which servo mode ends with an error",
        above(0.0),
        unit="mm/s",
    )
    speed_error: Literal[24, 60] = setting(
        60, Mark.OBSERVED, "error for a tool that is too fast: 60, or 24 of an older firmware"
    )
    # --- arm
    transport_delay_ms: float = setting(
        12.0, Mark.ASSUMED, "delay from a set point to the loops", between(0.0, 1000.0), unit="ms"
    )
    natural_frequency_rad_s: float = setting(
        60.0, Mark.ASSUMED, "natural frequency of the closed position loops", above(0.0), unit="rad/s"
    )
    damping_ratio: float = setting(
        1.0, Mark.ASSUMED, "damping ratio of the closed position loops", above(0.0)
    )
    collision_n: float = setting(
        150.0,
        Mark.ASSUMED,
        "force on the tool at which the collision detection stops the arm, error 31; 0: never",
        at_least(0.0),
        unit="N",
    )
    # --- force sensor
    sensor_on: bool = setting(False, Mark.ASSUMED, "the force sensor is on at power-up")
    zero_ms: float = setting(
        200.0, Mark.OBSERVED, "time until a zero is in effect", between(0.0, 10_000.0), unit="ms"
    )
    rate_hz: float = setting(200.0, Mark.ASSUMED, "samples per second", between(10.0, 10_000.0), unit="Hz")
    ranges: tuple[float, ...] = setting(
        (150.0, 150.0, 200.0, 4.0, 4.0, 4.0),
        Mark.DERIVED,
        "range of each axis, N and N·m: largest targets of the maker's client",
        above(0.0),
    )
    overload_share: float = setting(
        1.5, Mark.ASSUMED, "share of the range at which values are clipped, error 53", between(1.0, 10.0)
    )
    resolution_n: float = setting(0.1, Mark.ASSUMED, "step of the forces", above(0.0), unit="N")
    resolution_nm: float = setting(0.005, Mark.ASSUMED, "step of the moments", above(0.0), unit="N·m")
    zero_n: Vector = setting((0.0, 0.0, 0.0), Mark.ASSUMED, "raw forces without a load", unit="N")
    noise_n: PerAxis = setting(0.1, Mark.ASSUMED, *errors.NOISE_N)
    noise_nm: PerAxis = setting(0.005, Mark.ASSUMED, *errors.NOISE_NM)
    wander_n: PerAxis = setting(0.02, Mark.ASSUMED, *errors.WANDER_N)
    creep_share: float = setting(0.0, Mark.ASSUMED, *errors.CREEP_SHARE)

    def __post_init__(self) -> None:
        check_settings(self)
        check_errors(self)
        if len(self.ranges) != 6:
            raise SettingError("ranges", f"must be six values, got {len(self.ranges)}")

    @property
    def cycle_s(self) -> float:
        """Control cycle, s."""
        return self.control_ms / 1e3
