"""Settings that may differ between S3 controllers, or are unknown."""

from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

from emulators.arm.loops import ServoProfile
from emulators.quantiles import check_quantiles
from protocol.devices.s3.adlp import LinkProfile
from protocol.devices.s3.arap import Mode, RefusalCode
from protocol.marks import Mark, SettingError, above, at_least, between, check_settings, setting


@dataclass(frozen=True, slots=True)
class S3Profile:
    """Behaviour of the controller above the link, and size of the IRB 2000."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    # --- time and queue
    turnaround_ms: float = setting(
        12.0,
        Mark.ASSUMED,
        "mean time from the end of an order to the bid for its answer",
        at_least(0.0),
        unit="ms",
    )
    turnaround_spread_ms: float = setting(
        4.0,
        Mark.ASSUMED,
        "half width of the uniform distribution of the turnaround",
        at_least(0.0),
        unit="ms",
    )
    status_turnaround_ms: tuple[float, ...] = setting(
        (),
        Mark.CHOSEN,
        "measured turnaround of status orders as evenly spaced quantiles, in ascending order; "
        "empty: as assumed for all orders",
        at_least(0.0),
        unit="ms",
    )
    move_turnaround_ms: tuple[float, ...] = setting(
        (),
        Mark.CHOSEN,
        "measured turnaround of moves, in the same form; empty: as assumed for all orders",
        at_least(0.0),
        unit="ms",
    )
    queue_depth: int = setting(
        4, Mark.ASSUMED, "length of the queue of points, including the one that the arm moves to", at_least(1)
    )
    move_reply: Literal["queued", "reached"] = setting(
        "queued", Mark.ASSUMED, "time of the answer to a move: when it is queued, or when it is reached"
    )
    order_backlog: int = setting(
        4,
        Mark.ASSUMED,
        "length of the queue of orders, including the one being answered; further orders are lost",
        at_least(1),
    )
    # --- state
    power_up_mode: int = setting(
        int(Mode.STANDBY),
        Mark.ASSUMED,
        "mode after power-up: 0 standby, 1 operation, 2 synchronise, 3 both",
        between(0, 3),
    )
    link_control: bool = setting(True, Mark.CHOSEN, "the link has control at power-up, given on the pendant")
    no_control_refusal: int = setting(
        int(RefusalCode.WRONG_KEY_MODE),
        Mark.ASSUMED,
        "error code of an order without control of the link; read status is still answered",
        between(0, 255),
    )
    unusable_move_refusal: int = setting(
        int(RefusalCode.NOT_POSSIBLE),
        Mark.ASSUMED,
        "error code of a move without speed, with an invalid quaternion, or in robot coordinates",
        between(0, 255),
    )
    programs: tuple[int, ...] = setting(
        (1,), Mark.CHOSEN, "numbers of the programs in memory", between(0, 65535)
    )
    program_folder: str = setting(
        "",
        Mark.CHOSEN,
        "folder with the contents of programs, one file per program, named by its number, such "
        "as 7.prg; empty: no contents",
    )
    program_s: float = setting(
        10.0,
        Mark.ASSUMED,
        "run time of a program whose contents are not steps for the emulator",
        at_least(0.0),
        unit="s",
    )
    emergency_stop_error: tuple[int, int] = setting(
        (13, 0),
        Mark.ASSUMED,
        "x and y of the operational error at an emergency stop",
        between(0, 65535),
    )
    emergency_stop_keeps_standby: bool = setting(
        False,
        Mark.ASSUMED,
        "the status reports standby, too, during an emergency stop; the observed client checks "
        "standby first and would never show a stop then",
    )
    program_error: tuple[int, int] = setting(
        (15, 0),
        Mark.ASSUMED,
        "x and y of the operational error of a program that ends at a point outside the work area",
        between(0, 65535),
    )
    spontaneous_eot: Literal["always", "sometimes", "never"] = setting(
        "always",
        Mark.OBSERVED,
        "an unsolicited message ends with EOT: always, sometimes (one in two, drawn by the seed), never",
    )
    start_up_s: float = setting(
        5.0,
        Mark.ASSUMED,
        "time without response after a power-up during a run; at the start of a run the controller is ready",
        between(0.0, 3600.0),
        unit="s",
    )
    # --- size of the arm
    axis_2_height_mm: float = setting(
        780.0, Mark.OBSERVED, "distance from base to axis 2", above(0.0), unit="mm"
    )
    upper_arm_mm: float = setting(
        710.0, Mark.OBSERVED, "distance from axis 2 to axis 3", above(0.0), unit="mm"
    )
    elbow_offset_mm: float = setting(
        125.0, Mark.OBSERVED, "distance from axis 3 to the forearm's axis", at_least(0.0), unit="mm"
    )
    forearm_mm: float = setting(850.0, Mark.OBSERVED, "distance from elbow to wrist", above(0.0), unit="mm")
    wrist_to_flange_mm: float = setting(
        150.0, Mark.OBSERVED, "distance from wrist to flange", at_least(0.0), unit="mm"
    )
    # --- joints of the arm, axes 1 to 6
    axis_ranges_deg: tuple[float, float, float, float, float, float] = setting(
        (180.0, 100.0, 60.0, 200.0, 120.0, 200.0),
        Mark.OBSERVED,
        "range of each axis to either side of its middle",
        above(0.0, 360.0),
        unit="°",
    )
    axis_middles_deg: tuple[float, float, float, float, float, float] = setting(
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        Mark.ASSUMED,
        "middle of each axis range; at zero the arm points forward, the upper arm is upright, "
        "the forearm level, the wrist straight, and tool x points up",
        between(-180.0, 180.0),
        unit="°",
    )
    axis_3_against: Literal["horizon", "upper_arm"] = setting(
        "horizon",
        Mark.ASSUMED,
        "reference of the forearm's angle: horizon (its linkage keeps it level while axis 2 "
        "turns), upper_arm",
    )
    axis_speeds_deg_s: tuple[float, float, float, float, float, float] = setting(
        (115.0, 115.0, 115.0, 280.0, 300.0, 300.0),
        Mark.OBSERVED,
        "approximate maximum speed of each axis",
        above(0.0),
        unit="°/s",
    )

    def __post_init__(self) -> None:
        check_settings(self)
        check_quantiles(self, "status_turnaround_ms", "move_turnaround_ms")
        if self.turnaround_spread_ms > self.turnaround_ms:
            raise SettingError(
                "turnaround_spread_ms",
                f"must be at most turnaround_ms ({self.turnaround_ms:g}), got {self.turnaround_spread_ms:g}",
            )


@dataclass(frozen=True)  # no slots, so that a cell's profile can inherit it together with others
class S3Profiles:
    """Settings of an S3 robot: section `[cell.s3]`."""

    robot: S3Profile = field(default_factory=S3Profile)
    link: LinkProfile = field(default_factory=LinkProfile)
    servo: ServoProfile = field(default_factory=ServoProfile)
