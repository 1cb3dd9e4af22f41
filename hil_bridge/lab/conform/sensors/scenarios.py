"""The scenarios that a sensor's client is put through, and the rules by which it is judged."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from hil_bridge.lab.conform.trial import CUT, NOMINAL
from protocol.marks import Mark, above, at_least, between, check_settings, setting

LOST, STATUS, RESTART = "lost", "status", "restart"
SENSOR_SCENARIOS: Mapping[str, str] = {
    NOMINAL: "a known load comes on one axis after the other",
    LOST: "some of what the sensor sends is lost",
    STATUS: "the sensor says that its values are wrong, or that they are not new",
    CUT: "the wire is cut, and comes back",
    RESTART: "the sensor loses its supply, and boots",
}
"""In the order in which they are played."""


@dataclass(frozen=True, slots=True)
class SensorRules:
    """How long each part of a scenario takes, and the readings that are right."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    powered_s: float = setting(
        6.0,
        Mark.CHOSEN,
        "for how long the sensor has been powered when the client begins; an emulated Net F/T boots for 5 s",
        between(0.0, 600.0),
        unit="s",
    )
    start_s: float = setting(
        20.0, Mark.CHOSEN, "until a new client must have told a reading", above(0.0, 600.0), unit="s"
    )
    settle_s: float = setting(
        1.0, Mark.CHOSEN, "from the first reading to the first load or fault", above(0.0, 600.0), unit="s"
    )
    load_s: float = setting(
        1.5, Mark.CHOSEN, "for how long each axis is loaded in `nominal`", above(0.0, 60.0), unit="s"
    )
    react_s: float = setting(
        0.5,
        Mark.CHOSEN,
        "in which readings must follow a load, and end behind a fault",
        between(0.0, 60.0),
        unit="s",
    )
    watch_s: float = setting(
        2.0, Mark.CHOSEN, "for how long a client is watched behind a fault", above(0.0, 600.0), unit="s"
    )
    cut_s: float = setting(1.5, Mark.CHOSEN, "for how long the wire is cut", above(0.0, 60.0), unit="s")
    back_s: float = setting(
        10.0,
        Mark.CHOSEN,
        "in which readings must come back behind a cut or a restart",
        above(0.0, 600.0),
        unit="s",
    )
    end_s: float = setting(
        3.0, Mark.CHOSEN, "in which it must end when it is told to", above(0.0, 600.0), unit="s"
    )
    force_n: float = setting(10.0, Mark.CHOSEN, "load on an axis of force", above(0.0), unit="N")
    moment_nm: float = setting(1.0, Mark.CHOSEN, "load on an axis of moment", above(0.0), unit="N·m")
    tolerance_percent: float = setting(
        10.0, Mark.CHOSEN, "of a load, by which its mean reading may be off", between(0.0, 100.0), unit="%"
    )
    tolerance_n: float = setting(
        1.0, Mark.CHOSEN, "by which a mean force may be off at rest", at_least(0.0), unit="N"
    )
    tolerance_nm: float = setting(0.1, Mark.CHOSEN, "the same of a moment", at_least(0.0), unit="N·m")
    outlier: float = setting(
        5.0,
        Mark.CHOSEN,
        "so many times its tolerance a single reading may be off while data are lost",
        above(0.0),
    )
    takes_zero: bool = setting(
        False, Mark.CHOSEN, "the client declares that it takes the load at its start as zero"
    )
    comes_back: bool = setting(
        False, Mark.CHOSEN, "the client declares that it comes back behind a cut and a restart"
    )

    def __post_init__(self) -> None:
        check_settings(self)
