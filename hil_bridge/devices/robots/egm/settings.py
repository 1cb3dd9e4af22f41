"""Settings of the client of Externally Guided Motion: section `[robot.egm]`."""

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from protocol.marks import Mark, between, check_settings, setting


@dataclass(frozen=True, slots=True)
class EgmSettings:
    """Settings by which the bridge guides the robot."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    sample_ms: float = setting(
        4.0,
        Mark.CHOSEN,
        "SampleRate in the RAPID program: time between two datagrams of the robot",
        between(1.0, 1000.0),
        unit="ms",
    )
    feed_forward: bool = setting(
        True,
        Mark.CHOSEN,
        "answers carry the speed of the reference; without it the robot lags behind by the speed over its gain",
    )
    force_axes: Literal["tool", "base", "none"] = setting(
        "tool",
        Mark.ASSUMED,
        "axes of measuredForce, where datagrams have it: no source names them; none: it is ignored",
    )

    joints_in: Literal["degrees", "radians"] = setting(
        "degrees",
        Mark.OBSERVED,
        "unit of the joints in datagrams: radians of controllers before RobotWare 6.07.01. A robot whose pose fits the "
        "other unit, by the arm of cell.egm.arm, is refused",
    )

    def __post_init__(self) -> None:
        check_settings(self)
