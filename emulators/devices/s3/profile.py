"""Settings that may differ between one S3 controller and the next, or are not known of any."""

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
        12.0, Mark.ASSUMED, "from an order's end to the bid for its answer, mean", at_least(0.0), unit="ms"
    )
    turnaround_spread_ms: float = setting(
        4.0, Mark.ASSUMED, "uniform spread of the turnaround to either side", at_least(0.0), unit="ms"
    )
    status_turnaround_ms: tuple[float, ...] = setting(
        (),
        Mark.CHOSEN,
        "measured turnaround of status orders as evenly spaced quantiles, least first and largest last; empty: as "
        "assumed for all orders",
        at_least(0.0),
        unit="ms",
    )
    move_turnaround_ms: tuple[float, ...] = setting(
        (),
        Mark.CHOSEN,
        "measured turnaround of moves, in the same way; empty: as assumed for all orders",
        at_least(0.0),
        unit="ms",
    )
    queue_depth: int = setting(
        4, Mark.ASSUMED, "points accepted and not yet reached, the one moved to included", at_least(1)
    )
    move_reply: Literal["queued", "reached"] = setting(
        "queued", Mark.ASSUMED, "when a move is answered: queued, reached"
    )
    order_backlog: int = setting(
        4, Mark.ASSUMED, "orders kept, the one being answered included; more are lost", at_least(1)
    )
    # --- state
    power_up_mode: int = setting(
        int(Mode.STANDBY),
        Mark.ASSUMED,
        "mode after power-up: 0 standby, 1 operation, 2 synchronise, 3 both",
        between(0, 3),
    )
    link_control: bool = setting(True, Mark.CHOSEN, "the pendant has given the link control at power-up")
    no_control_refusal: int = setting(
        int(RefusalCode.WRONG_KEY_MODE),
        Mark.ASSUMED,
        "code that refuses orders while the link has no control; read status is answered",
        between(0, 255),
    )
    unusable_move_refusal: int = setting(
        int(RefusalCode.NOT_POSSIBLE),
        Mark.ASSUMED,
        "code that refuses a move without speed, without a unit quaternion, or in robot coordinates",
        between(0, 255),
    )
    programs: tuple[int, ...] = setting(
        (1,), Mark.CHOSEN, "numbers of the programs in memory", between(0, 65535)
    )
    program_folder: str = setting(
        "",
        Mark.CHOSEN,
        "folder with the contents of programs, files named by program number as in 7.prg; empty: none",
    )
    program_s: float = setting(
        10.0,
        Mark.ASSUMED,
        "how long a program runs whose contents are not steps for the emulator",
        at_least(0.0),
        unit="s",
    )
    emergency_stop_error: tuple[int, int] = setting(
        (13, 0),
        Mark.ASSUMED,
        "x and y of the operational error told at an emergency stop",
        between(0, 65535),
    )
    emergency_stop_keeps_standby: bool = setting(
        False,
        Mark.ASSUMED,
        "whether the status tells standby too while it tells emergency stop; the observed client looks at standby "
        "first and would never show a stop then",
    )
    program_error: tuple[int, int] = setting(
        (15, 0),
        Mark.ASSUMED,
        "x and y of the operational error told when a program ends at a point outside the work area",
        between(0, 65535),
    )
    spontaneous_eot: Literal["always", "sometimes", "never"] = setting(
        "always",
        Mark.OBSERVED,
        "whether an unasked message ends with EOT: always, sometimes (one in two, drawn), never",
    )
    start_up_s: float = setting(
        5.0,
        Mark.ASSUMED,
        "silence after a power-up at run time; a cell is found with its controller ready",
        between(0.0, 3600.0),
        unit="s",
    )
    # --- size of the arm
    axis_2_height_mm: float = setting(780.0, Mark.OBSERVED, "base to axis 2", above(0.0), unit="mm")
    upper_arm_mm: float = setting(710.0, Mark.OBSERVED, "axis 2 to axis 3", above(0.0), unit="mm")
    elbow_offset_mm: float = setting(
        125.0, Mark.OBSERVED, "axis 3 to the forearm's axis", at_least(0.0), unit="mm"
    )
    forearm_mm: float = setting(850.0, Mark.OBSERVED, "elbow to wrist", above(0.0), unit="mm")
    wrist_to_flange_mm: float = setting(150.0, Mark.OBSERVED, "wrist to flange", at_least(0.0), unit="mm")
    # --- joints of the arm, axes 1 to 6
    axis_ranges_deg: tuple[float, float, float, float, float, float] = setting(
        (180.0, 100.0, 60.0, 200.0, 120.0, 200.0),
        Mark.OBSERVED,
        "how far each axis turns to either side of the middle of its range",
        above(0.0, 360.0),
        unit="°",
    )
    axis_middles_deg: tuple[float, float, float, float, float, float] = setting(
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        Mark.ASSUMED,
        "middle of each range; zero is arm forward, upper arm upright, forearm level, wrist straight, tool x up",
        between(-180.0, 180.0),
        unit="°",
    )
    axis_3_against: Literal["horizon", "upper_arm"] = setting(
        "horizon",
        Mark.ASSUMED,
        "what the forearm's angle is read against: horizon (its linkage keeps it level while axis 2 turns), "
        "upper_arm",
    )
    axis_speeds_deg_s: tuple[float, float, float, float, float, float] = setting(
        (115.0, 115.0, 115.0, 280.0, 300.0, 300.0),
        Mark.OBSERVED,
        "about the fastest that each axis turns",
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


@dataclass(frozen=True)  # without slots, so that a cell's profile may inherit it beside others
class S3Profiles:
    """Everything that may differ between one S3 robot and the next. The section `[cell.s3]`."""

    robot: S3Profile = field(default_factory=S3Profile)
    link: LinkProfile = field(default_factory=LinkProfile)
    servo: ServoProfile = field(default_factory=ServoProfile)
