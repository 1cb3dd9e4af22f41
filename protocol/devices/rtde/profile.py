"""Settings of the client: the connection to a controller, and the parameters of the controller's servo program."""

from dataclasses import dataclass
from typing import Any, ClassVar

from protocol.marks import Mark, above, between, check_settings, setting


@dataclass(frozen=True, slots=True)
class ClientProfile:
    """Settings for communication with a Universal Robots controller."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    cycle_ms: float = setting(
        2.0,
        Mark.OBSERVED,
        "time between two data packets: 2 for an e-Series, 8 for a CB3",
        between(2.0, 100.0),
        unit="ms",
    )
    dashboard_port: int = setting(
        29999, Mark.OBSERVED, "TCP port of the dashboard; 0: the dashboard is not used", between(0, 65535)
    )
    script_port: int = setting(30002, Mark.OBSERVED, "TCP port that receives programs", between(1, 65535))
    lookahead_s: float = setting(
        0.03,
        Mark.OBSERVED,
        "servoj's lookahead_time, approximately the lag of a slow motion; a longer one is smoother",
        between(0.03, 0.2),
        unit="s",
    )
    gain: float = setting(
        2000.0, Mark.OBSERVED, "servoj's gain; a smaller one is softer", between(100.0, 2000.0)
    )
    hold_ms: float = setting(
        100.0,
        Mark.ASSUMED,
        "time without a new target after which the program brakes",
        between(10.0, 1000.0),
        unit="ms",
    )
    watchdog_hz: float = setting(
        10.0,
        Mark.ASSUMED,
        "lowest rate of packets from this computer; below it the controller stops the program",
        between(1.0, 100.0),
        unit="Hz",
    )
    brake_m_s2: float = setting(
        2.0, Mark.ASSUMED, "deceleration with which the program brakes", above(0.0, 10.0), unit="m/s²"
    )
    joint_step_rad: float = setting(
        0.03,
        Mark.CHOSEN,
        "largest change of a joint between two targets; the program refuses a pose that needs more",
        above(0.0, 0.3),
        unit="rad",
    )
    silent_ms: float = setting(
        100.0,
        Mark.CHOSEN,
        "time without a data packet after which a movement ends",
        between(10.0, 1000.0),
        unit="ms",
    )
    report_age_cycles: float = setting(
        1.0, Mark.ASSUMED, "age of a reported pose, in cycles", between(0.0, 10.0)
    )

    def __post_init__(self) -> None:
        check_settings(self)

    @property
    def cycle_s(self) -> float:
        """Time between two data packets, s."""
        return self.cycle_ms / 1000.0

    @property
    def hold_cycles(self) -> int:
        """Number of cycles without a new target after which the program brakes."""
        return max(1, round(self.hold_ms / self.cycle_ms))
