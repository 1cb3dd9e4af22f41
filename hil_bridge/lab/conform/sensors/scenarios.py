"""Scenarios for sensor clients, and the rules by which they are judged."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from hil_bridge.lab.conform.trial import CUT, NOMINAL
from protocol.marks import Mark, above, at_least, between, check_settings, setting

LOST, STATUS, RESTART = "lost", "status", "restart"
SENSOR_SCENARIOS: Mapping[str, str] = {
    NOMINAL: "a known load on one axis after the other",
    LOST: "some of the sensor's data are lost",
    STATUS: "the sensor reports its values as invalid or stale",
    CUT: "the link is cut, and restored",
    RESTART: "the sensor loses its supply, and boots",
}
"""Description of each scenario, in the order of execution."""


@dataclass(frozen=True, slots=True)
class SensorRules:
    """Durations of the parts of a scenario, and tolerances of the readings."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    powered_s: float = setting(
        6.0,
        Mark.CHOSEN,
        "time between power-up and the start of the client; an emulated Net F/T boots for 5 s",
        between(0.0, 600.0),
        unit="s",
    )
    start_s: float = setting(
        20.0, Mark.CHOSEN, "time in which a new client must report a reading", above(0.0, 600.0), unit="s"
    )
    settle_s: float = setting(
        1.0,
        Mark.CHOSEN,
        "time from the first reading to the first load or fault",
        above(0.0, 600.0),
        unit="s",
    )
    load_s: float = setting(
        1.5, Mark.CHOSEN, "duration of the load on each axis in `nominal`", above(0.0, 60.0), unit="s"
    )
    react_s: float = setting(
        0.5,
        Mark.CHOSEN,
        "time in which readings must follow a load, and end after a fault",
        between(0.0, 60.0),
        unit="s",
    )
    watch_s: float = setting(2.0, Mark.CHOSEN, "observation time after a fault", above(0.0, 600.0), unit="s")
    cut_s: float = setting(1.5, Mark.CHOSEN, "duration of the cut", above(0.0, 60.0), unit="s")
    back_s: float = setting(
        10.0,
        Mark.CHOSEN,
        "time in which readings must resume after a cut or a restart",
        above(0.0, 600.0),
        unit="s",
    )
    end_s: float = setting(3.0, Mark.CHOSEN, "time to terminate on request", above(0.0, 600.0), unit="s")
    force_n: float = setting(10.0, Mark.CHOSEN, "load on a force axis", above(0.0), unit="N")
    moment_nm: float = setting(1.0, Mark.CHOSEN, "load on a moment axis", above(0.0), unit="N·m")
    tolerance_percent: float = setting(
        10.0, Mark.CHOSEN, "tolerance of the mean reading of a load", between(0.0, 100.0), unit="%"
    )
    tolerance_n: float = setting(
        1.0, Mark.CHOSEN, "tolerance of the unloaded mean force", at_least(0.0), unit="N"
    )
    tolerance_nm: float = setting(
        0.1, Mark.CHOSEN, "tolerance of the unloaded mean moment", at_least(0.0), unit="N·m"
    )
    outlier: float = setting(
        5.0,
        Mark.CHOSEN,
        "tolerance of a single reading while data are lost, in multiples of the unloaded tolerance",
        above(0.0),
    )
    takes_zero: bool = setting(False, Mark.CHOSEN, "the client takes the load at its start as zero")
    comes_back: bool = setting(False, Mark.CHOSEN, "the client reconnects after a cut and a restart")

    def __post_init__(self) -> None:
        check_settings(self)
