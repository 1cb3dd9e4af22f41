"""Settings of an RSI link: properties of the controller's program and configuration that the client must know."""

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from protocol.marks import Mark, above, at_least, check_settings, setting


@dataclass(frozen=True, slots=True)
class RsiLink:
    """Settings that both ends must agree on, and limits that the client enforces."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    mode: Literal["relative", "absolute"] = setting(
        "relative", Mark.CHOSEN, "argument of RSI_ON in the controller's program"
    )
    cycle_ms: Literal[4, 12] = setting(
        4, Mark.OBSERVED, "time between two telegrams: 4 (#IPO_FAST) or 12 (#IPO)", unit="ms"
    )
    sentype: str = setting("ImFree", Mark.OBSERVED, "SENTYPE of the controller's Ethernet configuration")
    correction_tag: str = setting(
        "RKorr",
        Mark.OBSERVED,
        "element that its signal flow uses as the Cartesian correction, in the base frame",
    )
    correction: Literal["pose", "axes"] = setting(
        "pose",
        Mark.CHOSEN,
        "input of its signal flow: a pose (POSCORR), or axes (AXISCORR), which need the arm's kinematics",
    )
    axis_tag: str = setting(
        "AK", Mark.OBSERVED, "element that its signal flow uses as the correction of the axes"
    )
    model: Literal["kr16-2"] = setting(
        "kr16-2", Mark.CHOSEN, "model of the arm, for corrections of the axes; its base is the program's"
    )
    limit_axis_deg: float = setting(
        60.0,
        Mark.CHOSEN,
        "largest total correction of each axis; keep it below AXISCORR's limit",
        above(0.0),
        unit="°",
    )
    fastest_axis_deg_s: float = setting(
        100.0,
        Mark.CHOSEN,
        "maximum speed of each axis; a KR 16-2 allows 156 for its slowest ones",
        above(0.0),
        unit="°/s",
    )
    limit_mm: float = setting(
        200.0,
        Mark.CHOSEN,
        "largest total correction along an axis; keep it below POSCORR's limit",
        above(0.0),
        unit="mm",
    )
    limit_deg: float = setting(
        20.0,
        Mark.CHOSEN,
        "largest total correction of each angle; keep it below POSCORR's limit",
        above(0.0),
        unit="°",
    )
    fastest_mm_s: float = setting(
        200.0,
        Mark.CHOSEN,
        "maximum speed of a correction, whatever the set point does",
        above(0.0),
        unit="mm/s",
    )
    fastest_deg_s: float = setting(
        80.0, Mark.CHOSEN, "maximum speed of a correction of each angle", above(0.0), unit="°/s"
    )
    catch_up_mm_s: float = setting(
        10.0,
        Mark.CHOSEN,
        "additional speed over the set point with which a robot catches up after lost answers",
        above(0.0),
        unit="mm/s",
    )
    catch_up_deg_s: float = setting(
        5.0,
        Mark.CHOSEN,
        "additional angular speed over the set point with which a robot catches up after lost answers",
        above(0.0),
        unit="°/s",
    )
    stray_mm: float = setting(
        1.0,
        Mark.CHOSEN,
        "distance between the robot and its correction above which a deviation is reported",
        above(0.0),
        unit="mm",
    )
    late_max: int = setting(
        25,
        Mark.CHOSEN,
        "consecutive answers that the robot may ignore before it counts as faulty; it is "
        "stationary meanwhile",
        at_least(1),
    )

    def __post_init__(self) -> None:
        check_settings(self)
