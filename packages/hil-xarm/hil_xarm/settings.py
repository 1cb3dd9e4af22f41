"""Settings of the robot's client: section `[robot.xarm]`."""

from dataclasses import dataclass
from typing import Any, ClassVar

from protocol.marks import Mark, above, at_least, between, check_settings, setting


@dataclass(frozen=True, slots=True)
class XarmSettings:
    """Settings with which the bridge drives the robot."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    cycle_ms: float = setting(
        10.0, Mark.OBSERVED, "period of the real reports of port 30003", between(4.0, 1000.0), unit="ms"
    )
    speed_mm_s: float = setting(
        250.0,
        Mark.CHOSEN,
        "largest speed between two servo targets; beyond 1000 mm/s the box stops with error 24 or 60",
        above(0.0, 1000.0),
        unit="mm/s",
    )
    turn_deg_s: float = setting(
        60.0, Mark.CHOSEN, "largest rotational speed between two servo targets", above(0.0, 180.0), unit="°/s"
    )
    acceleration_mm_s2: float = setting(
        2000.0,
        Mark.CHOSEN,
        "acceleration of the servo targets: that of the maker's client for a motion",
        above(0.0, 50_000.0),
        unit="mm/s²",
    )
    turn_acceleration_deg_s2: float = setting(
        800.0, Mark.CHOSEN, "rotational acceleration of the servo targets", above(0.0), unit="°/s²"
    )
    shortest_ms: float = setting(
        4.0,
        Mark.OBSERVED,
        "shortest time between two servo commands: the box takes 250 in a second, and loses the rest",
        at_least(0.0),
        unit="ms",
    )
    clears_error: bool = setting(
        True, Mark.CHOSEN, "an error is cleared at the start of a run, because an operator starts it"
    )
    answer_s: float = setting(
        2.0, Mark.OBSERVED, "time limit for an answer; that of the maker's client", at_least(0.1), unit="s"
    )
    ready_s: float = setting(
        2.0,
        Mark.CHOSEN,
        "time limit from the last command of the start until a report shows servo mode",
        at_least(0.1),
        unit="s",
    )
    keep_alive_s: float = setting(
        10.0,
        Mark.DERIVED,
        "time without a command after which the state is requested; the maker's client waits for 30 s",
        above(0.0, 30.0),
        unit="s",
    )

    def __post_init__(self) -> None:
        check_settings(self)

    @property
    def cycle_s(self) -> float:
        """Period of the reports, s."""
        return self.cycle_ms / 1e3


@dataclass(frozen=True, slots=True)
class ForceSettings:
    """Settings of the client of the force sensor: section `[sensor.xarm]`."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    external: bool = setting(
        False,
        Mark.CHOSEN,
        "use the external values, from which the box subtracts its zero and the load set in it; otherwise the raw ones",
    )
    ranges: tuple[float, float, float, float, float, float] = setting(
        (150.0, 150.0, 200.0, 4.0, 4.0, 4.0),
        Mark.DERIVED,
        "range of each axis, N and N·m, beyond which a run retracts: largest targets of the maker's client",
        above(0.0),
    )
    cycle_ms: float = setting(
        10.0, Mark.OBSERVED, "period of the real reports of port 30003", between(4.0, 1000.0), unit="ms"
    )
    settle_s: float = setting(
        0.5,
        Mark.OBSERVED,
        "time from switching the sensor on until its values count; that of the maker's examples",
        between(0.0, 60.0),
        unit="s",
    )
    zero_s: float = setting(
        0.1, Mark.CHOSEN, "duration over which a zero is averaged", between(0.0, 10.0), unit="s"
    )
    ask_s: float = setting(
        1.0, Mark.CHOSEN, "time between two requests of the error of the box", above(0.0, 30.0), unit="s"
    )
    answer_s: float = setting(
        2.0, Mark.OBSERVED, "time limit for an answer; that of the maker's client", at_least(0.1), unit="s"
    )

    def __post_init__(self) -> None:
        check_settings(self)

    @property
    def cycle_s(self) -> float:
        """Period of the reports, s."""
        return self.cycle_ms / 1e3
