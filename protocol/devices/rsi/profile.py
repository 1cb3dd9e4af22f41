"""Facts that a client of the Robot Sensor Interface has to know of the controller's program and configuration."""

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from protocol.marks import Mark, above, at_least, check_settings, setting


@dataclass(frozen=True, slots=True)
class RsiLink:
    """Settings that both ends have to agree upon, and the bounds that the client keeps."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    mode: Literal["relative", "absolute"] = setting(
        "relative", Mark.CHOSEN, "what the controller's program gives to RSI_ON"
    )
    cycle_ms: Literal[4, 12] = setting(
        4, Mark.OBSERVED, "time between two telegrams: 4 (#IPO_FAST) or 12 (#IPO)", unit="ms"
    )
    sentype: str = setting("ImFree", Mark.OBSERVED, "SENTYPE of the controller's Ethernet configuration")
    correction_tag: str = setting(
        "RKorr", Mark.OBSERVED, "element that its signal flow takes for the Cartesian correction, in the base"
    )
    correction: Literal["pose", "axes"] = setting(
        "pose",
        Mark.CHOSEN,
        "what its signal flow takes: a pose (POSCORR), or axes (AXISCORR), which need the arm's kinematics",
    )
    axis_tag: str = setting(
        "AK", Mark.OBSERVED, "element that its signal flow takes for the correction of the axes"
    )
    model: Literal["kr16-2"] = setting(
        "kr16-2", Mark.CHOSEN, "the arm, for corrections of the axes; its base is the program's"
    )
    limit_axis_deg: float = setting(
        60.0, Mark.CHOSEN, "largest total of each axis; keep it below AXISCORR's", above(0.0), unit="°"
    )
    fastest_axis_deg_s: float = setting(
        100.0,
        Mark.CHOSEN,
        "fastest turn of each axis; a KR 16-2 allows 156 of its slowest ones",
        above(0.0),
        unit="°/s",
    )
    limit_mm: float = setting(
        200.0,
        Mark.CHOSEN,
        "largest total correction of an axis; keep it below POSCORR's",
        above(0.0),
        unit="mm",
    )
    limit_deg: float = setting(
        20.0, Mark.CHOSEN, "largest total of each angle; keep it below POSCORR's", above(0.0), unit="°"
    )
    fastest_mm_s: float = setting(
        200.0, Mark.CHOSEN, "fastest correction, whatever the set point does", above(0.0), unit="mm/s"
    )
    fastest_deg_s: float = setting(80.0, Mark.CHOSEN, "the same for each angle", above(0.0), unit="°/s")
    catch_up_mm_s: float = setting(
        10.0,
        Mark.CHOSEN,
        "by how much faster than its set point a robot moves to make up for answers that were lost",
        above(0.0),
        unit="mm/s",
    )
    catch_up_deg_s: float = setting(5.0, Mark.CHOSEN, "the same for each angle", above(0.0), unit="°/s")
    stray_mm: float = setting(
        1.0, Mark.CHOSEN, "distance of a robot from its correction that is told", above(0.0), unit="mm"
    )
    late_max: int = setting(
        25,
        Mark.CHOSEN,
        "answers in a row that the robot may not take before it is taken for faulty; it stands still meanwhile",
        at_least(1),
    )

    def __post_init__(self) -> None:
        check_settings(self)
