"""Settings of the bridge's client: how it reaches a controller, and how the controller's program servos."""

from dataclasses import dataclass
from typing import Any, ClassVar

from protocol.marks import Mark, check_settings, setting


@dataclass(frozen=True, slots=True)
class ClientProfile:
    """How the bridge talks to a controller of Universal Robots."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    cycle_ms: float = setting(
        2.0,
        Mark.OBSERVED,
        "time between two data packets: 2 for an e-Series, 8 for a CB3",
        unit="ms",
        minimum=2.0,
        maximum=100.0,
    )
    dashboard_port: int = setting(
        29999, Mark.OBSERVED, "TCP port of the dashboard; 0 asks it nothing", minimum=0, maximum=65535
    )
    script_port: int = setting(30002, Mark.OBSERVED, "TCP port that takes programs", minimum=1, maximum=65535)
    lookahead_s: float = setting(
        0.03,
        Mark.OBSERVED,
        "servoj's lookahead_time, about what a slow motion lags; a longer one is smoother",
        unit="s",
        minimum=0.03,
        maximum=0.2,
    )
    gain: float = setting(
        2000.0, Mark.OBSERVED, "servoj's gain; a smaller one is softer", minimum=100.0, maximum=2000.0
    )
    hold_ms: float = setting(
        100.0,
        Mark.ASSUMED,
        "the program brakes after so long without a new target",
        unit="ms",
        minimum=10.0,
        maximum=1000.0,
    )
    watchdog_hz: float = setting(
        10.0,
        Mark.ASSUMED,
        "the controller stops the program when packages come more rarely",
        unit="Hz",
        minimum=1.0,
        maximum=100.0,
    )
    brake_m_s2: float = setting(
        2.0, Mark.ASSUMED, "deceleration with which the program brakes", unit="m/s²", above=0.0, maximum=10.0
    )
    joint_step_rad: float = setting(
        0.03,
        Mark.CHOSEN,
        "the program refuses a pose for which a joint would go farther from one target to the next",
        unit="rad",
        above=0.0,
        maximum=0.3,
    )
    silent_ms: float = setting(
        100.0,
        Mark.CHOSEN,
        "a movement ends after so long without a data packet",
        unit="ms",
        minimum=10.0,
        maximum=1000.0,
    )
    report_age_cycles: float = setting(
        1.0, Mark.ASSUMED, "age of a reported pose, in cycles", minimum=0.0, maximum=10.0
    )

    def __post_init__(self) -> None:
        check_settings(self)

    @property
    def cycle_s(self) -> float:
        """Time between two data packets, s."""
        return self.cycle_ms / 1000.0

    @property
    def hold_cycles(self) -> int:
        """Cycles without a new target after which the program brakes."""
        return max(1, round(self.hold_ms / self.cycle_ms))
