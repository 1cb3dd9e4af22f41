"""Settings of the client of Externally Guided Motion: section `[robot.egm]`."""

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from protocol.marks import Mark, between, check_settings, setting


@dataclass(frozen=True, slots=True)
class EgmSettings:
    """Settings with which the bridge guides the robot."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    sample_ms: float = setting(
        4.0,
        Mark.CHOSEN,
        "SampleRate of the RAPID program: time between two datagrams of the robot",
        between(1.0, 1000.0),
        unit="ms",
    )
    feed_forward: bool = setting(
        True,
        Mark.CHOSEN,
        "orders include the speed of the reference; without it the robot lags by the speed "
        "divided by its gain",
    )
    force_axes: Literal["tool", "base", "none"] = setting(
        "tool",
        Mark.ASSUMED,
        "frame of measuredForce in datagrams; no source specifies it; none: the force is ignored",
    )

    joints_in: Literal["degrees", "radians"] = setting(
        "degrees",
        Mark.OBSERVED,
        "unit of the joints in datagrams: radians for controllers before RobotWare 6.07.01. A "
        "robot whose pose matches the other unit, by the arm of cell.egm.arm, is refused",
    )

    def __post_init__(self) -> None:
        check_settings(self)
